// The scene that every compiled peer is given: Fig. 3 of Nakano and Popov (2020), inputs/fig3.nml, to 2.5 s.
//
// Three formulations, SI units:
//   printed, smoothed   y = (u_x, u_y, w_x, w_y):  u' = V e - w,  m w' = K u - F(|w|) w/r,  r = |w| or sqrt(|w|^2 + v_s^2)
//   polar               y = (u_x, u_y, v, theta):  w = v n,  v' = (K u.n - F(v))/m,  theta' = K u.t/(m v)
// The polar one comes with our stops and releases: Peer::slip integrates down to a small v, `follow` does the rest.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <ctime>
#include <map>
#include <stdexcept>
#include <string>
#include <vector>

namespace scene {

constexpr double mass = 0.25, k_x = 1.0e3, k_y = 1.0e7;                      // kg, N/m
constexpr double misalignment = 1.0 * 3.14159265358979323846 / 180.0;        // rad
constexpr double mu_0 = 0.20, mu_inf = 0.15, v_f = 0.010, normal_load = 10;  // -, -, m/s, N
constexpr double drive_velocity = 1.0e-3, velocity_ratio = 1.0e-6;           // m/s, -
constexpr double static_limit = mu_0 * normal_load;                          // N
const std::vector<double> sample_times = {0.02, 0.5, 2.0, 2.5};              // s
const double t_end = sample_times.back();

const double drive_x = drive_velocity * std::cos(misalignment), drive_y = drive_velocity * std::sin(misalignment);

using State = std::array<double, 4>;

inline double friction(double v) { return (mu_inf + (mu_0 - mu_inf) * std::exp(-v / v_f)) * normal_load; }
inline double friction_slope(double v) { return -(mu_0 - mu_inf) / v_f * std::exp(-v / v_f) * normal_load; }

// Printed (v_s = 0) and smoothed. Pointers, so that every peer's own vector fits.
inline void cartesian_rhs(const double* y, double* dy, double v_s) {
  const double v = std::hypot(y[2], y[3]);
  const double drag = friction(v) / std::sqrt(v * v + v_s * v_s);
  dy[0] = drive_x - y[2];
  dy[1] = drive_y - y[3];
  dy[2] = (k_x * y[0] - drag * y[2]) / mass;
  dy[3] = (k_y * y[1] - drag * y[3]) / mass;
}

// jacobian(i, j) is set to d(dy_i)/dy_j.
template <class Matrix>
void cartesian_jacobian(const double* y, Matrix&& jacobian, double v_s) {
  const double v = std::hypot(y[2], y[3]), r = std::sqrt(v * v + v_s * v_s);
  const double drag = friction(v) / r;
  const double change = v > 0 ? friction_slope(v) / (v * r) - friction(v) / (r * r * r) : 0;
  for (int i = 0; i < 4; ++i)
    for (int j = 0; j < 4; ++j) jacobian(i, j) = 0;
  jacobian(0, 2) = jacobian(1, 3) = -1;
  jacobian(2, 0) = k_x / mass;
  jacobian(3, 1) = k_y / mass;
  for (int i = 2; i < 4; ++i)
    for (int j = 2; j < 4; ++j) jacobian(i, j) = -(change * y[i] * y[j] + (i == j ? drag : 0)) / mass;
}

// Below v_floor = floor_share v_cut, where no motion lies, 1/v is held: an attempt that overshoots the stop stays finite.
constexpr double floor_share = 0.5;

inline void polar_rhs(const double* y, double* dy, double v_floor) {
  const double c = std::cos(y[3]), s = std::sin(y[3]), f_x = k_x * y[0], f_y = k_y * y[1];
  dy[0] = drive_x - y[2] * c;
  dy[1] = drive_y - y[2] * s;
  dy[2] = (f_x * c + f_y * s - friction(y[2])) / mass;
  dy[3] = (f_y * c - f_x * s) / (mass * std::max(y[2], v_floor));
}

template <class Matrix>
void polar_jacobian(const double* y, Matrix&& jacobian, double v_floor) {
  const double c = std::cos(y[3]), s = std::sin(y[3]), f_x = k_x * y[0], f_y = k_y * y[1];
  const double inertia = mass * std::max(y[2], v_floor), across = f_y * c - f_x * s;
  const double rows[4][4] = {
      {0, 0, -c, y[2] * s},
      {0, 0, -s, -y[2] * c},
      {k_x * c / mass, k_y * s / mass, -friction_slope(y[2]) / mass, across / mass},
      {-k_x * s / inertia, k_y * c / inertia, y[2] > v_floor ? -across / (inertia * y[2]) : 0,
       -(f_x * c + f_y * s) / inertia}};
  for (int i = 0; i < 4; ++i)
    for (int j = 0; j < 4; ++j) jacobian(i, j) = rows[i][j];
}

// Sizes of the polar and Cartesian unknowns, to which absolute tolerances refer.
constexpr State polar_scale = {1e-7, 1e-7, 1e-5, 1.0}, cartesian_scale = {1e-7, 1e-7, 1e-5, 1e-5};

inline double load(const State& y) { return std::hypot(k_x * y[0], k_y * y[1]); }

// Rest until |K u| = F_0, a quadratic equation for the delay.
struct Rest {
  State from;
  double delay = 0;

  explicit Rest(const State& y) : from{y[0], y[1], 0, 0} {
    const double f = load(y), g_x = k_x * drive_x, g_y = k_y * drive_y;
    if (f >= static_limit) return;
    const double a = g_x * g_x + g_y * g_y, b = g_x * k_x * y[0] + g_y * k_y * y[1];
    const double c = (static_limit - f) * (static_limit + f), root = std::sqrt(b * b + a * c);
    delay = b > 0 ? c / (b + root) : (root - b) / a;
  }
  State at(double dt) const { return {from[0] + drive_x * dt, from[1] + drive_y * dt, 0, 0}; }
};

// Slip from rest as a power series in time: v starts with (|K u| - F_0)/m, which is zero at a release.
// It ends where its last terms are below `tolerance`.
struct Release {
  static constexpr int order = 12;
  std::array<double, order + 2> u_x{}, u_y{}, v{}, theta{}, c{}, s{}, decay{};
  double delay = 0;

  Release(const State& y, double tolerance) {
    const double f_0 = std::max(load(y), static_limit);
    const double excess = load(y) > static_limit * (1 + 1e-14) ? load(y) - static_limit : 0;
    u_x[0] = y[0], u_y[0] = y[1];
    theta[0] = std::atan2(k_y * y[1], k_x * y[0]);
    c[0] = std::cos(theta[0]), s[0] = std::sin(theta[0]);
    decay[0] = 1;
    for (int k = 0; k <= order; ++k) {
      if (k > 0) angle(k, f_0);
      double along = 0, slip_x = 0, slip_y = 0;
      for (int i = 0; i <= k; ++i) {
        along += k_x * u_x[i] * c[k - i] + k_y * u_y[i] * s[k - i];
        slip_x += v[i] * c[k - i];
        slip_y += v[i] * s[k - i];
        if (i > 0) decay[k] -= i * v[i] * decay[k - i] / (k * v_f);
      }
      const double drag = (mu_0 - mu_inf) * normal_load * decay[k];
      v[k + 1] = (k == 0 ? excess : along - drag) / (mass * (k + 1));
      u_x[k + 1] = ((k == 0 ? drive_x : 0) - slip_x) / (k + 1);
      u_y[k + 1] = ((k == 0 ? drive_y : 0) - slip_y) / (k + 1);
    }
    const int first = excess > 0 ? 1 : 2;
    delay = 0.25 * std::sqrt(mass / k_y);
    for (int k = order - 1; k <= order; ++k) {
      delay = std::min(delay, std::pow(tolerance * v[first] / (std::abs(v[k]) + 1e-300), 1.0 / (k - first)));
      delay = std::min(delay, std::pow(tolerance / (std::abs(theta[k]) + 1e-300), 1.0 / k));
    }
  }

  State at(double dt) const { return {sum(u_x, dt), sum(u_y, dt), sum(v, dt), sum(theta, dt)}; }

 private:
  // theta_k from m v theta' = K u.t at order k, then cos and sin of the series.
  void angle(int k, double f_0) {
    for (int j = 1; j < k; ++j) {
      c[k] -= j * theta[j] * s[k - j] / k;
      s[k] += j * theta[j] * c[k - j] / k;
    }
    double across = 0;
    for (int i = 0; i <= k; ++i) across += k_y * u_y[i] * c[k - i] - k_x * u_x[i] * s[k - i];
    for (int j = 1; j < k; ++j) across -= mass * j * theta[j] * v[k + 1 - j];
    theta[k] = across / (f_0 + mass * k * v[1]);
    c[k] -= theta[k] * s[0];
    s[k] += theta[k] * c[0];
  }

  static double sum(const std::array<double, order + 2>& a, double t) {
    double value = 0;
    for (int k = order; k >= 0; --k) value = value * t + a[k];
    return value;
  }
};

// The end of slip from a small v: direction held, v falls with the acceleration and jerk that it has.
struct Brake {
  State from;
  double acceleration, jerk, delay = 0;
  bool stops;

  explicit Brake(const State& y) : from(y) {
    const double c = std::cos(y[3]), s = std::sin(y[3]);
    acceleration = (k_x * y[0] * c + k_y * y[1] * s - friction(y[2])) / mass;
    jerk = (k_x * (drive_x - y[2] * c) * c + k_y * (drive_y - y[2] * s) * s - friction_slope(y[2]) * acceleration) / mass;
    const double discriminant = acceleration * acceleration - 2 * jerk * y[2];
    stops = discriminant >= 0 && acceleration < 0;
    if (stops) delay = 2 * y[2] / (std::sqrt(discriminant) - acceleration);
  }
  State at(double dt) const {
    const double way = dt * (from[2] + dt * (acceleration / 2 + dt * jerk / 6));
    return {from[0] + drive_x * dt - way * std::cos(from[3]), from[1] + drive_y * dt - way * std::sin(from[3]),
            from[2] + dt * (acceleration + dt * jerk / 2), from[3]};
  }
};

// "key=value" arguments.
struct Options {
  std::map<std::string, std::string> given;

  Options(int argc, char** argv) {
    for (int i = 1; i < argc; ++i) {
      const std::string word = argv[i];
      const auto cut = word.find('=');
      given[word.substr(0, cut)] = word.substr(cut + 1);
    }
  }
  std::string text(const std::string& key, const std::string& fallback) const {
    const auto found = given.find(key);
    return found == given.end() ? fallback : found->second;
  }
  double number(const std::string& key, double fallback) const {
    const auto found = given.find(key);
    return found == given.end() ? fallback : std::stod(found->second);
  }
};

struct LimitReached : std::runtime_error {
  LimitReached() : std::runtime_error("time limit") {}
};

// What a run leaves: (u_x, u_y, w_x, w_y) at the sample times, and how it ended.
class Record {
 public:
  explicit Record(const Options& options)
      : polar(options.text("formulation", "polar") == "polar"), limit(options.number("limit", 60)),
        begun(std::clock()) {}

  const bool polar;
  double time = 0;
  long stops = 0, steps = 0;

  bool finished() const { return states.size() == sample_times.size(); }
  double next_sample() const { return sample_times[states.size()]; }

  void sample(const State& y) {
    states.push_back(polar ? State{y[0], y[1], y[2] * std::cos(y[3]), y[2] * std::sin(y[3])} : y);
  }

  // A piece of motion known in closed form that begins at `time`. False if the end of the run lies in it.
  template <class Piece>
  bool pass(const Piece& piece) {
    while (!finished() && next_sample() <= time + piece.delay) sample(piece.at(next_sample() - time));
    time += piece.delay;
    return !finished();
  }

  void step() {
    if (++steps % 256 == 0 && seconds() > limit) throw LimitReached();
  }

  // Processor time, which other users of the machine do not lengthen.
  double seconds() const { return double(std::clock() - begun) / CLOCKS_PER_SEC; }

  void print(const std::string& status) const {
    std::printf("{\"status\": \"%s\", \"seconds\": %.6e, \"time\": %.9e, \"stops\": %ld, \"steps\": %ld, \"states\": [",
                status.c_str(), seconds(), time, stops, steps);
    for (std::size_t i = 0; i < states.size(); ++i)
      std::printf("%s[%.17g, %.17g, %.17g, %.17g]", i ? ", " : "", states[i][0], states[i][1], states[i][2], states[i][3]);
    std::printf("]}\n");
  }

 private:
  double limit;
  std::clock_t begun;
  std::vector<State> states;
};

// Slip, stop, rest and release in turn. peer.slip(y, first_step, cut, record) integrates the polar equations from
// record.time to the first falling v = cut or to the end of the run, keeps record.time, and takes the samples.
template <class Peer>
void follow(Peer& peer, const Options& options, Record& record) {
  const double v_cut = options.number("v_cut", 1e-8), share = options.number("first_step", 0.3);
  const double tolerance = std::max(0.1 * options.number("rtol", 1e-6), 1e-14);
  State y = {0, 0, velocity_ratio * drive_velocity, misalignment};
  double first_step = 0.1 * mass * y[2] / static_limit;
  while (!record.finished()) {
    // A dip below v_cut need not be a stop; then slip goes on, watched at a lower speed.
    double cut = v_cut;
    while (!(y[2] <= 1.5 * cut && Brake(y).stops)) {
      peer.slip(y, first_step, cut, record);
      if (record.finished()) return;
      if (!(y[2] > 0)) throw std::runtime_error("fell through the stop");
      if (y[2] <= 1.5 * cut && !Brake(y).stops) cut = 0.1 * y[2];
    }
    const Brake brake(y);
    if (!record.pass(brake)) return;
    ++record.stops;
    const Rest rest(brake.at(brake.delay));
    if (!record.pass(rest)) return;
    const Release release(rest.at(rest.delay), tolerance);
    if (!record.pass(release)) return;
    y = release.at(release.delay);
    first_step = share * release.delay;
  }
}

// The whole run, from start to the printed line. peer.integrate(record) does the Cartesian formulations.
template <class Peer>
void run(Peer& peer, const Options& options) {
  Record record(options);
  try {
    if (record.polar)
      follow(peer, options, record);
    else
      peer.integrate(State{0, 0, velocity_ratio * drive_x, velocity_ratio * drive_y}, record);
    record.print("done");
  } catch (const std::exception& failure) {
    record.print(failure.what());
  }
}

}  // namespace scene
