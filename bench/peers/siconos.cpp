// Siconos: Moreau-Jean time stepping of a body that its weight presses on a plane, with 3D Coulomb contact.
//   siconos method=kernel|fc3d formulation=nonsmooth h=… [limit=…]
// kernel: its simulation (TimeStepping, MoreauJeanOSI, FrictionContact). fc3d: its contact solver alone, in a loop of ours over the
// same steps. In both the law of a contact has one coefficient, which is set before each step to mu of the last slip velocity.
#include <NonSmoothDrivers.h>
#include <SiconosKernel.hpp>
#include <SolverOptions.h>
#include <cmath>
#include <memory>

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

// Axes of the contact in both: normal, x, y.
class Kernel {
 public:
  explicit Kernel(double h, const State& start)
      : q(std::make_shared<SiconosVector>(3)), v(std::make_shared<SiconosVector>(3)),
        law(std::make_shared<NewtonImpactFrictionNSL>(0, 0, scene::mu_0, 3)) {
    q->zero(), v->zero();
    // The plane is above the body: the gap alone says whether the contact is closed, and rounding must not open it.
    (*q)(0) = -unit;
    (*v)(1) = unit * start[2], (*v)(2) = unit * start[3];
    const auto mass = diagonal(scene::mass, scene::mass, scene::mass);
    const auto body = std::make_shared<LagrangianLinearTIDS>(q, v, mass);
    body->setKPtr(diagonal(0, scene::k_x, scene::k_y));
    body->setComputeFExtFunction(&pull);
    // The body's own, no longer those of the start.
    q = body->q(), v = body->velocity();

    const auto model = std::make_shared<NonSmoothDynamicalSystem>(0.0, 2 * scene::t_end);
    model->insertDynamicalSystem(body);
    model->link(std::make_shared<Interaction>(law, std::make_shared<LagrangianLinearTIR>(diagonal(1, 1, 1))), body);
    const auto solver = std::make_shared<FrictionContact>(3, solver_of_one_contact);
    solver->numericsSolverOptions()->dparam[SICONOS_DPARAM_TOL] = tolerance;
    simulation = std::make_shared<TimeStepping>(model, std::make_shared<TimeDiscretisation>(0.0, h),
                                                std::make_shared<MoreauJeanOSI>(theta), solver);
  }

  void step() {
    law->setMu(friction_coefficient((*v)(1), (*v)(2)));
    simulation->computeOneStep();
    simulation->nextStep();
  }

  State state(double t) const {
    return {scene::drive_x * t - (*q)(1) / unit, scene::drive_y * t - (*q)(2) / unit, (*v)(1) / unit, (*v)(2) / unit};
  }

 private:
  SP::SiconosVector q, v;
  SP::NewtonImpactFrictionNSL law;
  SP::TimeStepping simulation;

  static std::shared_ptr<SimpleMatrix> diagonal(double a, double b, double c) {
    const auto matrix = std::make_shared<SimpleMatrix>(3, 3);
    matrix->zero();
    (*matrix)(0, 0) = a, (*matrix)(1, 1) = b, (*matrix)(2, 2) = c;
    return matrix;
  }

  static void pull(double time, unsigned int, double* force, unsigned int, double*) {
    force[0] = -unit * scene::normal_load;
    force[1] = unit * scene::k_x * scene::drive_x * time;
    force[2] = unit * scene::k_y * scene::drive_y * time;
  }
};

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

  State state(double) const { return {u[1] / unit, u[2] / unit, w[1] / unit, w[2] / unit}; }

 private:
  const double h, stiffness[3] = {0, scene::k_x, scene::k_y}, weight[3] = {unit * scene::normal_load, 0, 0};
  const double drive[3] = {0, unit * scene::drive_x, unit * scene::drive_y};
  double u[3], w[3], w_free[3], inertia[3], impulse[3] = {0, 0, 0}, mu = scene::mu_0;
  FrictionContactProblem* problem;
  SolverOptions* options;
};

template <class Method>
struct Peer {
  double h;

  void slip(State&, double, double, scene::Record&) { throw std::runtime_error("no polar formulation"); }

  void integrate(const State& start, scene::Record& record) {
    Method method(h, start);
    bool slipped = true;
    for (long k = 1; !record.finished(); ++k) {
      method.step();
      record.time = k * h;
      record.step();
      const State y = method.state(record.time);
      const bool slips = std::hypot(y[2], y[3]) > rest;
      record.stops += slipped && !slips;
      slipped = slips;
      if (k == std::lround(record.next_sample() / h)) record.sample(y);
    }
  }
};

template <class Method>
void run(const scene::Options& options) {
  Peer<Method> peer{options.number("h", 1e-6)};
  scene::run(peer, options);
}

int main(int argc, char** argv) {
  const scene::Options options(argc, argv);
  options.text("method", "kernel") == "fc3d" ? run<Fc3d>(options) : run<Kernel>(options);
}
