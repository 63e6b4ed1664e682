// Siconos: the contact solver of its numerics (3D Coulomb contact) in a loop of ours over Moreau-Jean steps of a body that its weight presses
// on a plane.
//   siconos method=fc3d formulation=nonsmooth h=… [limit=…]
// The law of a contact has one coefficient, which is set before each step to mu of the last slip velocity.
#include <FrictionContactProblem.h>
#include <Friction_cst.h>
#include <NonSmoothDrivers.h>
#include <NumericsMatrix.h>
#include <SolverOptions.h>
#include <cmath>

#include "scene.hpp"

using scene::State;

// Lengths and forces are in these parts of m and N, so that impulses of short steps stay above absolute thresholds in the solvers.
constexpr double unit = 1e6, theta = 0.5, tolerance = 1e-14;
// Below this is the residue of the solver at rest, in m/s.
constexpr double rest = 1e-10;
constexpr auto solver_of_one_contact = SICONOS_FRICTION_3D_ONECONTACT_NSN_GP_HYBRID;

double friction_coefficient(double w_x, double w_y) {
  return scene::friction(std::hypot(w_x, w_y) / unit) / scene::normal_load;
}

// Axes of the contact: normal, x, y.
class Fc3d {
 public:
  Fc3d(double h, const State& start)
      : h(h), u{0, unit * start[0], unit * start[1]}, w{0, unit * start[2], unit * start[3]},
        problem(frictionContactProblem_new_with_data(3, 1, NM_create(NM_DENSE, 3, 3), w_free, &mu)),
        options(solver_options_create(solver_of_one_contact)) {
    options->dparam[SICONOS_DPARAM_TOL] = tolerance;
    for (int i = 0; i < 9; ++i) problem->M->matrix0[i] = 0;
    for (int i = 0; i < 3; ++i) {
      inertia[i] = scene::mass + h * h * theta * theta * stiffness[i];
      problem->M->matrix0[4 * i] = 1 / inertia[i];
    }
  }

  void step() {
    mu = friction_coefficient(w[1], w[2]);
    double w_old[3];
    for (int i = 0; i < 3; ++i) {
      const double force = stiffness[i] * (u[i] + theta * h * (drive[i] - (1 - theta) * w[i]));
      w_free[i] = (scene::mass * w[i] + h * (force - weight[i])) / inertia[i];
      w_old[i] = w[i];
    }
    // The solvers of one contact give the impulse alone.
    if (fc3d_driver(problem, impulse, w, options) != 0) throw std::runtime_error("no solution of the contact");
    for (int i = 0; i < 3; ++i) w[i] = w_free[i] + impulse[i] / inertia[i];
    for (int i = 0; i < 3; ++i) u[i] += h * (drive[i] - theta * w[i] - (1 - theta) * w_old[i]);
  }

  State state() const { return {u[1] / unit, u[2] / unit, w[1] / unit, w[2] / unit}; }

 private:
  const double h, stiffness[3] = {0, scene::k_x, scene::k_y}, weight[3] = {unit * scene::normal_load, 0, 0};
  const double drive[3] = {0, unit * scene::drive_x, unit * scene::drive_y};
  double u[3], w[3], w_free[3], inertia[3], impulse[3] = {0, 0, 0}, mu = scene::mu_0;
  FrictionContactProblem* problem;
  SolverOptions* options;
};

struct Peer {
  double h;

  void slip(State&, double, double, scene::Record&) { throw std::runtime_error("no polar formulation"); }

  void integrate(const State& start, scene::Record& record) {
    Fc3d method(h, start);
    bool slipped = true;
    for (long k = 1; !record.finished(); ++k) {
      method.step();
      record.time = k * h;
      record.step();
      const State y = method.state();
      const bool slips = std::hypot(y[2], y[3]) > rest;
      record.stops += slipped && !slips;
      slipped = slips;
      if (k == std::lround(record.next_sample() / h)) record.sample(y);
    }
  }
};

int main(int argc, char** argv) {
  const scene::Options options(argc, argv);
  Peer peer{options.number("h", 1e-6)};
  scene::run(peer, options);
}
