/* The equations of `low_frequency` for AUTO-07p, which calls these functions by their names.
 *
 * Unknowns u[0] = k_x u_x/F_0 and u[1] = w_x/V, time in units of 1/omega. AUTO counts parameters from 1 and keeps the period in
 * number 11. */
#include "auto_f2c.h"
#include <math.h>
#include <stdio.h>

enum { PHI_DEG, DRIVE, SWING, IMPEDANCE, V_F, MU_RATIO };

int func(integer ndim, const doublereal *u, const integer *icp, const doublereal *par, integer ijac, doublereal *f,
         doublereal *dfdu, doublereal *dfdp)
{
  const double phi = par[PHI_DEG] * atan(1.0) / 45.0, inertia = par[DRIVE] * par[IMPEDANCE];
  const double speed = hypot(u[1], sin(phi));
  const double friction = par[MU_RATIO] + (1.0 - par[MU_RATIO]) * exp(-par[DRIVE] * speed / par[V_F]);

  f[0] = inertia * (cos(phi) - u[1]);
  f[1] = (u[0] - friction * u[1] / speed) / inertia;
  return 0;
}

/* Steady sliding: start.txt has phi [deg], V [mm/s], sqrt(m k_x)/F_0 [s/mm], v_f [mm/s] and mu_inf/mu_0. */
int stpnt(integer ndim, doublereal t, doublereal *u, doublereal *par)
{
  FILE *start = fopen("start.txt", "r");
  double phi;

  if (start == NULL ||
      fscanf(start, "%lf%lf%lf%lf%lf", &par[PHI_DEG], &par[DRIVE], &par[IMPEDANCE], &par[V_F], &par[MU_RATIO]) != 5) {
    fprintf(stderr, "start.txt: five numbers are needed\n");
    return 1;
  }
  fclose(start);
  phi = par[PHI_DEG] * atan(1.0) / 45.0;
  u[1] = cos(phi);
  u[0] = (par[MU_RATIO] + (1.0 - par[MU_RATIO]) * exp(-par[DRIVE] / par[V_F])) * cos(phi);
  return 0;
}

/* The amplitude of u[0], peak to peak. */
int pvls(integer ndim, const doublereal *u, doublereal *par)
{
  extern double getp(const char *code, integer ic, const doublereal *u);

  par[SWING] = getp("MAX", 1, u) - getp("MIN", 1, u);
  return 0;
}

int bcnd(integer ndim, const doublereal *par, const integer *icp, integer nbc, const doublereal *u0, const doublereal *u1,
         integer ijac, doublereal *fb, doublereal *dbc)
{
  return 0;
}

int icnd(integer ndim, const doublereal *par, const integer *icp, integer nint, const doublereal *u, const doublereal *uold,
         const doublereal *udot, const doublereal *upold, integer ijac, doublereal *fi, doublereal *dint)
{
  return 0;
}

int fopt(integer ndim, const doublereal *u, const integer *icp, const doublereal *par, integer ijac, doublereal *fs,
         doublereal *dfdu, doublereal *dfdp)
{
  return 0;
}
