// Boost odeint: rosenbrock4 (implicit) and runge_kutta_dopri5 (explicit), both with their dense output.
//   odeint method=rosenbrock4|dopri5 formulation=polar|printed|smoothed rtol=… [v_cut=…] [v_s=…] [limit=…]
#include <boost/numeric/odeint.hpp>
#include <boost/numeric/ublas/matrix.hpp>
#include <boost/numeric/ublas/vector.hpp>
#include <utility>

#include "scene.hpp"

namespace ublas = boost::numeric::ublas;
namespace odeint = boost::numeric::odeint;
using scene::State;

// odeint's tolerances are the same for all unknowns, so these are given in units of their sizes.
struct Equations {
  bool polar;
  double v_s, v_floor = 0;

  const State& scale() const { return polar ? scene::polar_scale : scene::cartesian_scale; }

  template <class Vector>
  State physical(const Vector& z) const {
    State y;
    for (int i = 0; i < 4; ++i) y[i] = z[i] * scale()[i];
    return y;
  }

  template <class Vector>
  void rhs(const Vector& z, Vector& dz) const {
    const State y = physical(z);
    State dy;
    polar ? scene::polar_rhs(y.data(), dy.data(), v_floor) : scene::cartesian_rhs(y.data(), dy.data(), v_s);
    for (int i = 0; i < 4; ++i) dz[i] = dy[i] / scale()[i];
  }

  void jacobian(const ublas::vector<double>& z, ublas::matrix<double>& matrix) const {
    const State y = physical(z);
    const auto entry = [&](int i, int j) -> double& { return matrix(i, j); };
    polar ? scene::polar_jacobian(y.data(), entry, v_floor) : scene::cartesian_jacobian(y.data(), entry, v_s);
    for (int i = 0; i < 4; ++i)
      for (int j = 0; j < 4; ++j) matrix(i, j) *= scale()[j] / scale()[i];
  }
};

struct Rosenbrock {
  using Vector = ublas::vector<double>;
  using Stepper = odeint::rosenbrock4_dense_output<odeint::rosenbrock4_controller<odeint::rosenbrock4<double>>>;

  static Vector vector() { return Vector(4); }
  static Stepper stepper(double rtol) { return odeint::make_dense_output(rtol, rtol, odeint::rosenbrock4<double>()); }
  static auto system(const Equations& equations) {
    return std::make_pair([&equations](const Vector& z, Vector& dz, double) { equations.rhs(z, dz); },
                          [&equations](const Vector& z, ublas::matrix<double>& j, double, Vector& dt) {
                            equations.jacobian(z, j);
                            dt.clear();
                          });
  }
  template <class System>
  static void single_step(System system, Vector& z, double t, double dt) {
    odeint::rosenbrock4<double>().do_step(system, z, t, dt);
  }
};

struct Dopri {
  using Vector = State;
  using Stepper = odeint::result_of::make_dense_output<odeint::runge_kutta_dopri5<State>>::type;

  static Vector vector() { return {}; }
  static Stepper stepper(double rtol) { return odeint::make_dense_output(rtol, rtol, odeint::runge_kutta_dopri5<State>()); }
  static auto system(const Equations& equations) {
    return [&equations](const Vector& z, Vector& dz, double) { equations.rhs(z, dz); };
  }
  template <class System>
  static void single_step(System system, Vector& z, double t, double dt) {
    odeint::runge_kutta_dopri5<State>().do_step(system, z, t, dt);
  }
};

template <class Method>
class Peer {
 public:
  explicit Peer(const scene::Options& options)
      : rtol(options.number("rtol", 1e-6)), equations{options.text("formulation", "polar") == "polar", options.number("v_s", 0)} {}

  void slip(State& y, double first_step, double cut, scene::Record& record) {
    equations.v_floor = scene::floor_share * cut;
    advance(y, first_step, cut, record);
  }

  void integrate(State y, scene::Record& record) { advance(y, 1e-12, 0, record); }

 private:
  double rtol;
  Equations equations;

  void advance(State& y, double first_step, double cut, scene::Record& record) {
    auto stepper = Method::stepper(rtol);
    auto system = Method::system(equations);
    auto z = Method::vector(), inner = Method::vector();
    for (int i = 0; i < 4; ++i) z[i] = y[i] / equations.scale()[i];
    stepper.initialize(z, record.time, first_step);
    while (!record.finished()) {
      const auto [from, to] = stepper.do_step(system);
      record.step();
      double end = to;
      const double before = speed(stepper.previous_state()), after = speed(stepper.current_state());
      if (!std::isfinite(after)) throw std::runtime_error("not finite");
      if (to <= from) throw std::runtime_error("step size underflow");
      const bool stopped = before > cut && after <= cut && equations.polar;
      if (stopped) end = crossing(stepper, inner, cut, from, to);
      while (!record.finished() && record.next_sample() <= end) {
        z = stepper.previous_state();
        Method::single_step(system, z, from, record.next_sample() - from);
        record.sample(equations.physical(z));
      }
      record.time = end;
      if (!stopped) continue;
      // The step again, up to the stop: more accurate than the dense output.
      z = stepper.previous_state();
      Method::single_step(system, z, from, end - from);
      y = equations.physical(z);
      return;
    }
  }

  template <class Vector>
  double speed(const Vector& z) const { return z[2] * equations.scale()[2]; }

  template <class Stepper, class Vector>
  double crossing(Stepper& stepper, Vector& z, double cut, double low, double high) const {
    for (int i = 0; i < 30; ++i) {
      const double middle = 0.5 * (low + high);
      stepper.calc_state(middle, z);
      (speed(z) > cut ? low : high) = middle;
    }
    return low;
  }
};

template <class Method>
void run(const scene::Options& options) {
  Peer<Method> peer(options);
  scene::run(peer, options);
}

int main(int argc, char** argv) {
  const scene::Options options(argc, argv);
  options.text("method", "rosenbrock4") == "dopri5" ? run<Dopri>(options) : run<Rosenbrock>(options);
}
