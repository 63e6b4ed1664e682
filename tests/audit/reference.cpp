// An independent reference for the full model with the exact contact (docs/equations.md):
//
//     u' = V(t) e - w,     m w' = f - F(v) w/v,     f = K u + C (V e - w),     v = |w|,
//
// with every law of friction. A body at rest stays while |f| <= F_s, which may grow with the time at rest; a slip stops where v = 0 and |f| < F_0. It shares no code with
// src/ and takes another way:
//
// * the unknown is the Cartesian slip velocity w, not (v, theta); Radau IIA collocation of 12 stages (or as many as asked for), in
//   80-bit long doubles;
// * a step is judged by what its polynomial leaves of the equations between all the nodes, and by how far w turns between
//   them: no friction peak, no turn and no stop hides between two stages. No step is longer than half a period of the fast
//   oscillation, and none crosses a point of a friction table: there one ends;
// * slip begins with two terms of its series over 1e-6 of the shortest time of the scene;
// * where v is small, f and F are constant, and then F_0 v + f.w grows at the rate (|f|^2 - F_0^2)/m: it says when v = 0 comes.
//   Steps take 0.8 of the time that is left. If |f| < F_0, the body is at rest below 1e-10 of the largest speed since the release.
//   If |f| > F_0, the direction turns and slip goes on; below 1e-17 the turn takes no time. Only where it has nowhere to turn to,
//   because w and f are exactly on one line, the body stops, and stays if |f| <= F_s;
// * samples are ends of steps, so there is no interpolation.
//
// Input (stdin): lines "key values...", the keys of a deck, "samples times...", and "stages", "tolerance", "decimal".
// Output (stdout): "sample t u_x u_y w_x w_y X theta friction sticking V", "event t kind" (1: a rest begins, 2: slip begins),
// "note key value".
// g++ -O2 -std=c++17 reference.cpp -o reference

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <iostream>
#include <map>
#include <sstream>
#include <stdexcept>
#include <string>
#include <vector>

using real = long double;
using list = std::vector<real>;
static const real epsilon = 1.0842021724855044340e-19L;
static const real pi = 3.141592653589793238462643383279502884L;

static std::string text(real x) {
  char buffer[64];
  std::snprintf(buffer, sizeof buffer, "%.21Lg", x);
  return buffer;
}

struct vec {
  real x = 0, y = 0;
};
static vec operator+(vec a, vec b) { return {a.x + b.x, a.y + b.y}; }
static vec operator-(vec a, vec b) { return {a.x - b.x, a.y - b.y}; }
static vec operator*(real s, vec a) { return {s * a.x, s * a.y}; }
static vec operator*(vec a, vec b) { return {a.x * b.x, a.y * b.y}; }
static real dot(vec a, vec b) { return a.x * b.x + a.y * b.y; }
static real norm(vec a) { return std::sqrt(dot(a, a)); }
static vec left(vec a) { return {-a.y, a.x}; }

// ---------------------------------------------------------------------------------------------------------- the scene

// One cubic of a friction table: F(v) from the speed `start` on.
struct Panel {
  real start, end;
  std::array<real, 4> c;
};

struct Scene {
  real m, mu0, mu_inf, vf, exponent, viscous, load, ratio, t_end, tolerance;
  real limit, kinetic;  // F_s as rest begins, F_0
  real ageing, ageing_time;
  vec K, C, u0, e;
  list knot, velocity, samples;  // the drive is constant after its last knot
  std::vector<Panel> table;
  int stages;

  explicit Scene(std::istream& in) {
    std::map<std::string, list> given;
    bool decimal = false;  // 0.2 as it is written, and not the double beside it, which is what the package gets
    for (std::string line, key, word; std::getline(in, line);) {
      std::istringstream words(line);
      if (!(words >> key)) continue;
      list& values = given[key];
      while (words >> word) values.push_back(decimal ? std::strtold(word.c_str(), nullptr) : std::strtod(word.c_str(), nullptr));
      decimal = decimal || key == "decimal";
    }
    auto all = [&](const char* key, list otherwise) {
      const auto found = given.find(key);
      if (found == given.end()) return otherwise;
      const list values = found->second;
      given.erase(found);
      return values;
    };
    auto one = [&](const char* key, real otherwise) { return all(key, {otherwise}).at(0); };
    all("decimal", {});
    m = one("mass", 0), load = one("normal_load", 0), ratio = one("velocity_ratio", 0), t_end = one("t_end", 0);
    K.x = one("stiffness_x", 0), K.y = one("stiffness_y", 0), C.x = one("damping_x", 0), C.y = one("damping_y", 0);
    u0.x = one("elongation_x", 0), u0.y = one("elongation_y", 0);
    const real phi = one("misalignment_deg", 0) * pi / 180;
    e = {std::cos(phi), std::sin(phi)};
    const list speed = all("table_speed", {}), mu = all("table_mu", {});
    mu0 = one("mu_0", mu.empty() ? 0 : mu[0]), mu_inf = one("mu_inf", mu0), vf = one("v_f", 1);
    exponent = one("exponent", 1), viscous = one("viscous", 0);
    tabulate(speed, mu);
    kinetic = mu0 * load;
    limit = std::max(kinetic, one("mu_static", 0) * load);
    ageing = one("ageing", 0) * load, ageing_time = one("ageing_time", 1);
    knot = all("time", {0}), velocity = all("velocity", {0}), samples = all("samples", {});
    stages = static_cast<int>(one("stages", 12)), tolerance = one("tolerance", 1e-12L);
    if (!given.empty()) throw std::runtime_error("unknown key " + given.begin()->first);
    samples.push_back(t_end);
    std::sort(samples.begin(), samples.end());
    samples.erase(std::unique(samples.begin(), samples.end()), samples.end());
  }

  // Monotone cubics (Fritsch and Carlson 1980). The slope at a point is that of the parabola through it and its neighbours (at the
  // ends, of the nearest three points), at most three times the smaller slope beside it, and 0 if these have not its sign.
  void tabulate(const list& speed, const list& mu) {
    const int last = static_cast<int>(speed.size()) - 1;
    auto secant = [&](int i) { return (mu[i + 1] - mu[i]) / (speed[i + 1] - speed[i]); };
    auto slope = [&](int i) {
      if (last < 2) return secant(0);
      const int middle = std::min(std::max(i, 1), last - 1);
      const real before = secant(middle - 1), after = secant(middle), width = speed[middle + 1] - speed[middle - 1];
      const real parabola = before + (after - before) * (2 * speed[i] - speed[middle - 1] - speed[middle]) / width;
      const real one = secant(std::max(i - 1, 0)), other = secant(std::min(i, last - 1));
      if (one * parabola <= 0 || other * parabola <= 0) return real(0);
      return std::copysign(std::min(std::fabs(parabola), 3 * std::min(std::fabs(one), std::fabs(other))), parabola);
    };
    for (int i = 0; i < last; ++i) {
      const real width = speed[i + 1] - speed[i], s = secant(i), a = slope(i), b = slope(i + 1), bend = (a + b - 2 * s) / width;
      table.push_back({speed[i], speed[i + 1], {load * mu[i], load * a, load * ((s - a) / width - bend), load * bend / width}});
    }
    if (last > 0) table.push_back({speed[last], 1e4000L, {load * mu[last], 0, 0, 0}});
  }

  real limit_after(real age) const { return limit + ageing * std::log1p(age / ageing_time); }
  real power(real v) const { return exponent == 1 ? 1 : std::pow(v / vf, exponent - 1); }
  // Friction at a speed in the panel of the table, if there is one, and its slope.
  real friction(real v, size_t panel) const {
    if (table.empty()) return (mu_inf + (mu0 - mu_inf) * std::exp(-power(v) * v / vf) + viscous * v) * load;
    const Panel& p = table[panel];
    const real d = v - p.start;
    return p.c[0] + d * (p.c[1] + d * (p.c[2] + d * p.c[3]));
  }
  real slope(real v, size_t panel) const {
    if (table.empty())
      return (viscous - (mu0 - mu_inf) * std::exp(-power(v) * v / vf) * exponent * power(v) / vf) * load;
    const Panel& p = table[panel];
    const real d = v - p.start;
    return p.c[1] + d * (2 * p.c[2] + 3 * d * p.c[3]);
  }
  // A speed at which friction begins to change.
  real scale() const { return table.empty() ? vf : table[0].end; }
};

// One linear piece of V(t).
struct Piece {
  real start, end, velocity, acceleration;
  real at(real t) const { return velocity + acceleration * (t - start); }
  // D(t + d) - D(t)
  real travel(real t, real d) const { return d * (at(t) + acceleration * d / 2); }
};

static std::vector<Piece> pieces_of(const Scene& s) {
  std::vector<Piece> pieces;
  for (size_t i = 0; i < s.knot.size() && s.knot[i] < s.t_end; ++i) {
    const bool last = i + 1 == s.knot.size();
    const real end = last ? s.t_end : s.knot[i + 1];
    if (end <= s.knot[i]) continue;
    const real acceleration = last ? 0 : (s.velocity[i + 1] - s.velocity[i]) / (end - s.knot[i]);
    pieces.push_back({s.knot[i], std::min(end, s.t_end), s.velocity[i], acceleration});
  }
  return pieces;
}

// ----------------------------------------------------------------------------------------------- the collocation method

static std::array<real, 2> legendre(int n, real x) {  // P_n, P_{n-1}
  real before = 1, now = x;
  for (int k = 2; k <= n; ++k) {
    const real next = ((2 * k - 1) * x * now - (k - 1) * before) / k;
    before = now;
    now = next;
  }
  return {now, before};
}

// Zeros of a function, one between two neighbouring points where its sign changes.
template <class Function>
static list crossings(Function f, const list& point) {
  list found;
  for (size_t i = 0; i + 1 < point.size(); ++i) {
    real a = point[i], b = point[i + 1];
    const bool above = f(a) > 0;
    if (above == (f(b) > 0)) continue;
    for (int k = 0; k < 130; ++k) {
      const real c = (a + b) / 2;
      (f(c) > 0) == above ? a = c : b = c;
    }
    found.push_back((a + b) / 2);
  }
  return found;
}

// Zeros of a polynomial in (0, 1): between those of its derivative it is monotone.
static list zeros(const list& c) {
  if (c.size() < 2) return {};
  list derivative, point = {0};
  for (size_t k = 1; k < c.size(); ++k) derivative.push_back(k * c[k]);
  for (real zero : zeros(derivative)) point.push_back(zero);
  point.push_back(1);
  return crossings(
      [&](real x) {
        real sum = 0;
        for (size_t k = c.size(); k-- > 0;) sum = sum * x + c[k];
        return sum;
      },
      point);
}

struct Method {
  int s;
  list c, gauss;                         // nodes on (0, 1], the last is 1; those of Gauss on (-1, 1)
  list full = {0}, weight;               // 0 and the nodes, and their barycentric weights
  list probe;                            // points between the nodes
  std::vector<list> a, d;                // integrals at the nodes, derivatives at all of `full`
  std::vector<list> at, rate, integral;  // at the probes: value, derivative, integral
  std::vector<list> end_rate;            // first three derivatives at the end

  explicit Method(int stages) : s(stages) {
    list grid;
    for (int i = 0; i < 4000; ++i) grid.push_back(-std::cos(pi * (i + real(1) / 3) / 4000));
    const list root = crossings([&](real x) { return legendre(s, x)[0] - legendre(s, x)[1]; }, grid);
    for (int i = 0; i + 1 < s; ++i) c.push_back((1 + root.at(i)) / 2);
    c.push_back(1);
    gauss = crossings([&](real x) { return legendre(s, x)[0]; }, grid);
    full.insert(full.end(), c.begin(), c.end());
    for (int j = 0; j <= s; ++j) {
      real product = 1;
      for (int k = 0; k <= s; ++k)
        if (k != j) product *= full[j] - full[k];
      weight.push_back(1 / product);
    }
    d.assign(s + 1, list(s + 1));
    for (int i = 0; i <= s; ++i)
      for (int j = 0; j <= s; ++j)
        if (i != j) d[i][i] -= d[i][j] = weight[j] / weight[i] / (full[i] - full[j]);
    for (int i = 0; i < s; ++i) a.push_back(integrals(c[i]));
    for (int i = 0; i < s; ++i)
      for (int third : {1, 2}) {
        probe.push_back(full[i] + third * (c[i] - full[i]) / 3);
        at.push_back(values(probe.back()));
        rate.push_back(differentiated(at.back()));
        integral.push_back(integrals(probe.back()));
      }
    end_rate = {differentiated(values(1))};
    while (end_rate.size() < 3) end_rate.push_back(differentiated(end_rate.back()));
  }

  // What the values at 0 and the nodes count in the polynomial at x.
  list values(real x) const {
    list row(weight);
    real below = 1, above = 1;
    for (int j = 0; j <= s; ++j) {
      row[j] *= below, below *= x - full[j];
      row[s - j] *= above, above *= x - full[s - j];
    }
    return row;
  }

  list differentiated(const list& row) const {
    list found(s + 1);
    for (int i = 0; i <= s; ++i)
      for (int j = 0; j <= s; ++j) found[j] += row[i] * d[i][j];
    return found;
  }

  // The integrals until x of the polynomials through the nodes, by the formula of Gauss.
  list integrals(real x) const {
    list row(s);
    for (real g : gauss) {
      const real slope = s * legendre(s, g)[1] / (1 - g * g), share = 2 / ((1 - g * g) * slope * slope), tau = x * (1 + g) / 2;
      const list value = values(tau);
      // Without the point 0: the basis function of a node, over its factor x.
      for (int j = 0; j < s; ++j) row[j] += share * x / 2 * value[j + 1] * c[j] / tau;
    }
    return row;
  }
};

// ------------------------------------------------------------------------------------------------------------ the motion

// Newton's corrections need no more than double precision: what they leave is in the next residual.
static bool solve(std::vector<double>& matrix, std::vector<double>& right) {
  const size_t n = right.size();
  for (size_t k = 0; k < n; ++k) {
    size_t pivot = k;
    for (size_t i = k + 1; i < n; ++i)
      if (std::fabs(matrix[i * n + k]) > std::fabs(matrix[pivot * n + k])) pivot = i;
    if (!(std::fabs(matrix[pivot * n + k]) > 0)) return false;
    std::swap_ranges(&matrix[k * n], &matrix[k * n] + n, &matrix[pivot * n]);
    std::swap(right[pivot], right[k]);
    for (size_t i = k + 1; i < n; ++i) {
      const double factor = matrix[i * n + k] / matrix[k * n + k];
      if (factor == 0) continue;
      for (size_t j = k + 1; j < n; ++j) matrix[i * n + j] -= factor * matrix[k * n + j];
      right[i] -= factor * right[k];
    }
  }
  for (size_t k = n; k-- > 0;) {
    for (size_t j = k + 1; j < n; ++j) right[k] -= matrix[k * n + j] * right[j];
    right[k] /= matrix[k * n + k];
  }
  return true;
}

class Motion {
 public:
  explicit Motion(const Scene& scene) : s(scene), method(scene.stages), pieces(pieces_of(scene)), stage(method.s) {
    fast = std::sqrt(s.m / std::max(s.K.x, s.K.y));
    u = s.u0;
    X = -dot(u, s.e);
    w = s.ratio * s.velocity[0] * s.e;
    while (panel + 1 < s.table.size() && norm(w) >= s.table[panel].end) ++panel;
  }

  void run() {
    sample();  // t = 0
    if (norm(w) > 0) begin_at_speed();
    else if (norm(force(0, u, w)) > s.limit * (1 + 16 * epsilon)) begin_from_rest();
    else stick();
    while (t < s.t_end) {
      while (t >= pieces[piece].end && piece + 1 < pieces.size()) {
        ++piece;
        has_polynomial = false;
        // A corner of V is a corner of w'': begin again with short steps.
        h = std::min(h, fast / 8);
      }
      if (sticking) rest();
      else slide();
    }
    std::cout << "note fastest " << text(fastest) << "\nnote steps " << steps << "\nnote turns " << turns << "\n";
  }

 private:
  const Scene& s;
  Method method;
  std::vector<Piece> pieces;
  std::vector<vec> stage;            // w at the nodes
  size_t piece = 0, panel = 0, next_sample = 0;
  real t = 0, X = 0, fast = 0;
  real t_lost = 0;  // what the sums for t and u have lost to roundoff
  vec u_lost;
  vec u, w;
  bool sticking = false;
  real rest_since = 0;
  real h = 0;                        // the next step
  real peak = 0, fastest = 0;        // largest speed since the release, and of the run
  // The polynomial of the last step, for the first guess; after a release, a series.
  bool has_polynomial = false;
  real last_h = 0;
  vec last_w0;
  std::vector<vec> last_stage;
  vec series[4];
  long steps = 0, turns = 0;

  real V(real d) const { return pieces[piece].at(t + d); }
  real F(real v) const { return s.friction(v, panel); }
  // Force of springs and dampers, at the time t + d.
  vec force(real d, vec elongation, vec velocity) const { return s.K * elongation + s.C * (V(d) * s.e - velocity); }
  real horizon() const {
    const real end = pieces[piece].end;
    return next_sample < s.samples.size() ? std::min(end, s.samples[next_sample]) : end;
  }

  real time_left() const { return (horizon() - t) - t_lost; }

  // t + d and u + change, with what the sums before have lost.
  void pass(real d, vec change) {
    const real later = t + (d + t_lost);
    t_lost += d - (later - t);
    t = later;
    const vec there = u + (change + u_lost);
    u_lost = u_lost + (change - (there - u));
    u = there;
  }
  void arrive(real at) { t = at, t_lost = 0; }

  void event(int kind) { std::cout << "event " << text(t) << " " << kind << "\n"; }

  void sample() {
    const vec f = force(0, u, w), direction = !sticking && norm(w) > 0 ? w : f;
    for (; next_sample < s.samples.size() && s.samples[next_sample] <= t; ++next_sample) {
      const real theta = norm(direction) > 0 ? std::atan2(direction.y, direction.x) : 0;
      std::cout << "sample " << text(s.samples[next_sample]);
      for (real x : {u.x, u.y, w.x, w.y, X, theta, sticking ? norm(f) : F(norm(w))}) std::cout << " " << text(x);
      std::cout << " " << sticking << " " << text(V(0)) << "\n";
    }
  }

  // ---- rest

  void stick() {
    sticking = true;
    rest_since = t;
    w = {};
    event(1);
  }

  // To the release, the end of the piece, or the next sample. |f(d)|^2 is a polynomial of degree 4 in the share of this time.
  void rest() {
    const Piece& p = pieces[piece];
    const real limit = s.limit_after(t - rest_since);
    const real duration = time_left(), size = norm(force(0, u, w)), square = limit * limit;
    const vec f0 = force(0, u, w), f1 = duration * (V(0) * (s.K * s.e) + p.acceleration * (s.C * s.e));
    const vec f2 = duration * duration * p.acceleration / 2 * (s.K * s.e);
    const list excess = {std::min(real(0), (size - limit) * (size + limit) / square), 2 * dot(f0, f1) / square,
                         (dot(f1, f1) + 2 * dot(f0, f2)) / square, 2 * dot(f1, f2) / square, dot(f2, f2) / square};
    list release = size > limit * (1 + 16 * epsilon) ? list{0} : zeros(excess);  // at once where V has jumped
    if (s.ageing > 0 && !release.empty() && size <= limit * (1 + 16 * epsilon)) {
      // Not before the limit as it is now would be reached; then the first change of sign on a fine grid.
      list point = {release[0]};
      for (int i = 1; i <= 4000; ++i) point.push_back(release[0] + (1 - release[0]) * std::pow(real(i) / 4000, 3));
      release = crossings(
          [&](real x) { return norm(f0 + x * f1 + x * x * f2) - s.limit_after(t - rest_since + x * duration); }, point);
    }
    const real d = release.empty() ? duration : release[0] * duration;
    const real end = horizon();
    pass(d, p.travel(t, d) * s.e);
    if (release.empty()) {
      arrive(end);
      return sample();
    }
    event(2);
    begin_from_rest();
  }

  // ---- beginnings

  // From v = 0, in the direction n of f, with m v' = |f| - F_0 = m b: (|f| + m b) theta' = f'.side and m v'' = f'.n - F'(0) b.
  void begin_from_rest() {
    sticking = false;
    panel = 0;
    const vec f = force(0, u, {});
    const vec n = (1 / norm(f)) * f, side = left(n);
    const real q = pieces[piece].acceleration;
    real b = (norm(f) - s.kinetic) / s.m;
    if (b * s.m < 64 * epsilon * s.limit) b = 0;
    const vec g = V(0) * (s.K * s.e) + s.C * (q * s.e - b * n);
    const real turn = dot(g, side) / (norm(f) + s.m * b);
    const real slope = s.slope(0, 0), jerk = (dot(g, n) - slope * b) / s.m;
    // The shortest time of the scene.
    real unit = fast;
    for (real x : {s.limit / norm(g), s.m / std::fabs(slope), s.m / std::max(s.C.x, s.C.y), s.scale() / b, b / std::fabs(jerk),
                   std::sqrt(2 * s.scale() / std::max(jerk, real(0))), std::fabs(V(0) / q)})
      if (x > 0) unit = std::min(unit, x);
    const real noise = jerk > 0 && b == 0 ? 1000 * epsilon * s.limit / (s.m * jerk) : 0;
    const real d = std::min(std::max(real(1e-6L) * unit, noise), time_left());
    // w = (b d + jerk d^2/2)(n + turn d side) + O(d^3)
    series[1] = b * n;
    series[2] = jerk / 2 * n + b * turn * side;
    series[3] = jerk / 2 * turn * side;
    w = d * (series[1] + d * (series[2] + d * series[3]));
    advance(d, d * d * (real(1) / 2 * series[1] + d * (real(1) / 3 * series[2] + d / 4 * series[3])));
    // The series about the new place.
    series[1] = series[1] + 2 * d * series[2] + 3 * d * d * series[3];
    series[2] = series[2] + 3 * d * series[3];
    has_polynomial = false;
    h = 2 * d;
    peak = norm(w);
    if (t >= horizon()) sample();
  }

  void begin_at_speed() {
    const vec f = force(0, u, w);
    peak = norm(w);
    series[1] = (1 / s.m) * (f - (F(peak) / peak) * w);
    series[2] = series[3] = {};
    h = std::min(fast / 100, s.m * peak / (100 * (F(peak) + norm(f))));
  }

  void advance(real d, vec slipped) {
    pass(d, pieces[piece].travel(t, d) * s.e - slipped);
    X += dot(slipped, s.e);
  }

  // ---- slip

  vec polynomial(const list& row, vec start, const std::vector<vec>& values) const {
    vec sum = row[0] * start;
    for (int j = 0; j < method.s; ++j) sum = sum + row[j + 1] * values[j];
    return sum;
  }

  void guess(real step, bool whole) {
    for (int i = 0; i < method.s; ++i) {
      const real d = method.c[i] * step;
      if (whole) stage[i] = polynomial(method.values(1 + d / last_h), last_w0, last_stage);
      else stage[i] = w + d * (series[1] + d * (series[2] + d * series[3]));
    }
  }

  // Newton's method for the stages of a step.
  bool collocate(real step) {
    const int n = method.s;
    std::vector<double> matrix(4 * n * n), right(2 * n);
    const real per_mass = step / s.m;
    real eta_before = 1e30L;
    for (int iteration = 0; iteration < 15; ++iteration) {
      std::fill(matrix.begin(), matrix.end(), 0);
      for (int i = 0; i < n; ++i) {
        const real v = norm(stage[i]), d = method.c[i] * step;
        if (!(v > 0)) return false;
        vec slipped, change;
        for (int j = 0; j < n; ++j) {
          slipped = slipped + method.a[i][j] * stage[j];
          change = change + method.d[i + 1][j + 1] * (stage[j] - w);
        }
        const vec f = force(d, u + pieces[piece].travel(t, d) * s.e - step * slipped, stage[i]);
        const vec direction = (1 / v) * stage[i], side = left(direction);
        const vec residual = change - per_mass * (f - F(v) * direction);
        right[i] = -residual.x;
        right[n + i] = -residual.y;
        double *x = &matrix[i * 2 * n], *y = &matrix[(n + i) * 2 * n + n];  // the rows of this node, the blocks on the diagonal
        for (int j = 0; j < n; ++j) {
          x[j] = method.d[i + 1][j + 1] + per_mass * step * s.K.x * method.a[i][j];
          y[j] = method.d[i + 1][j + 1] + per_mass * step * s.K.y * method.a[i][j];
        }
        const real along = per_mass * s.slope(v, panel), across = per_mass * F(v) / v;
        x[i] += along * direction.x * direction.x + across * side.x * side.x + per_mass * s.C.x;
        y[i] += along * direction.y * direction.y + across * side.y * side.y + per_mass * s.C.y;
        x[n + i] = (y - n)[i] = along * direction.x * direction.y + across * side.x * side.y;
      }
      if (!solve(matrix, right)) return false;
      real eta = 0, largest = 0;
      bool fine = true;
      for (int i = 0; i < n; ++i) {
        const real v = norm(stage[i]), change = norm({right[i], right[n + i]});
        if (!(change < 1e30L * v)) return false;
        eta = std::max(eta, change / v);
        largest = std::max(largest, v);
        fine = fine && (change <= 1e-13L * v || change <= 64 * epsilon * per_mass * s.limit + 16 * epsilon * largest);
      }
      // A change larger than the velocity itself is not trusted.
      const real damp = eta > 0.7L ? real(0.7L) / eta : real(1);
      for (int i = 0; i < n; ++i) stage[i] = stage[i] + damp * vec{right[i], right[n + i]};
      if (fine) return true;
      if (iteration > 5 && eta > 0.5L * eta_before) return false;
      eta_before = eta;
    }
    return false;
  }

  // What the polynomial leaves of the equations between the nodes, as a share of the largest speed. If w turns too far or leaves
  // its panel of the table, -1; `until` is the share of the step before that.
  real defect(real step, real& until) const {
    const int n = method.s;
    real largest = norm(w), worst = 0, before = 0;
    for (const vec& each : stage) largest = std::max(largest, norm(each));
    vec last = w;
    for (size_t k = 0; k < method.probe.size(); ++k) {
      const real tau = method.probe[k], d = tau * step;
      const vec at = polynomial(method.at[k], w, stage), rate = polynomial(method.rate[k], w, stage);
      for (int node = 0; node <= static_cast<int>(k % 2); ++node) {
        const vec next = node ? stage[k / 2] : at;
        const real here = node ? method.c[k / 2] : tau;
        if (dot(last, next) < 0.5L * norm(last) * norm(next)) {
          until = real(0.9L) * tau;
          return -1;
        }
        if (side_of_panel(norm(next), 1) != 0) {
          // Half the way into the next panel that `side_of_panel` allows.
          const auto outside = [&](real x) { return side_of_panel(norm(polynomial(method.values(x), w, stage)), 0.5L) != 0; };
          const list out = crossings(outside, {before, here});
          until = out.empty() ? before / 2 : out[0];
          return -1;
        }
        last = next;
        before = here;
      }
      vec slipped;
      for (int j = 0; j < n; ++j) slipped = slipped + method.integral[k][j] * stage[j];
      const real v = norm(at);
      const vec f = force(d, u + pieces[piece].travel(t, d) * s.e - step * slipped, at);
      const vec direction = (1 / v) * at;
      const vec open = (1 / s.m) * (f - F(v) * direction) - (1 / step) * rate;
      const real floor = 256 * epsilon * (s.limit + norm(f)) / s.m;
      const real along = std::max(real(0), std::fabs(dot(open, direction)) - floor);
      const real across = std::max(real(0), std::fabs(dot(open, left(direction))) - floor) / (1 + step * F(v) / (s.m * v));
      worst = std::max(worst, step * std::max(along, across) / largest);
    }
    return worst;
  }

  // -1 or 1 if v is below or above the panel of the table by more than a share of 1e-9, which is too little to matter.
  int side_of_panel(real v, real share) const {
    if (s.table.empty()) return 0;
    return v > s.table[panel].end * (1 + share * 1e-9L) ? 1 : v < s.table[panel].start * (1 - share * 1e-9L) ? -1 : 0;
  }

  void slide() {
    const real v = norm(w);
    const vec f = force(0, u, w);
    const int side = side_of_panel(v, 0.4L);
    if (side != 0 && side * (dot(f, w) / v - F(v)) > 0) panel += side;
    peak = std::max(peak, v);
    const real stop = time_to_stop(v, f, F(v));
    if (stop > 0 && v < (norm(f) < s.kinetic ? 1e-10L : 1e-17L) * peak && finish(f)) return;
    const real end = time_left();
    real step = std::min(h, fast * pi);
    if (stop > 0) step = std::min(step, real(0.8L) * std::max(stop, s.m * v / (norm(f) + F(v))));
    bool to_end = false;
    if (step >= end * (1 - real(1e-12L))) step = end, to_end = true;
    else if (step > end / 2) step = end / 2;
    for (int attempt = 0;; ++attempt) {
      if (attempt > 200) throw std::runtime_error("step too short at t = " + text(t));
      bool good = false;
      for (bool whole : {true, false}) {
        if (whole && !(has_polynomial && step <= 2 * last_h)) continue;
        guess(step, whole);
        good = collocate(step);
        if (good) break;
      }
      real until = 1, factor = 0.4L;
      const real error = good ? defect(step, until) : 0;
      if (good && error >= 0 && error <= s.tolerance) return accept(step, to_end, error);
      if (good && error > 0) factor = std::min(real(0.8L), std::max(real(0.2L), growth(error)));
      else if (good) factor = until;
      step *= factor;
      to_end = false;
    }
  }

  real growth(real error) const { return real(0.85L) * std::pow(s.tolerance / error, real(1) / method.s); }

  // Time until v = 0 if f and friction are constant; negative if v grows.
  real time_to_stop(real v, vec f, real friction) const {
    return s.m * (friction * v + dot(f, w)) / ((friction - norm(f)) * (friction + norm(f)));
  }

  void accept(real step, bool to_end, real error) {
    const int n = method.s;
    if (++steps > 3000000) throw std::runtime_error("too many steps at t = " + text(t));
    vec slipped;
    for (int j = 0; j < n; ++j) slipped = slipped + method.a[n - 1][j] * stage[j];
    for (const vec& each : stage) peak = std::max(peak, norm(each));
    fastest = std::max(fastest, std::max(peak, norm(w)));
    real scale = 1;
    for (int order = 1; order <= 3; ++order) {
      scale /= order * step;
      series[order] = scale * polynomial(method.end_rate[order - 1], w, stage);
    }
    has_polynomial = true;
    last_h = step;
    last_w0 = w;
    last_stage = stage;
    const real end = horizon();
    advance(step, step * slipped);
    w = stage[n - 1];
    const real proposed = step * std::min(real(4), std::max(real(0.3L), error > 0 ? growth(error) : 4));
    h = to_end ? std::max(h, proposed) : proposed;
    if (!to_end) return;
    arrive(end);
    sample();
  }

  // The rest of a stop, or of the way to a turn, which takes no time. False if friction or force still change meanwhile.
  bool finish(vec f) {
    const real v = norm(w), stop = time_to_stop(v, f, s.kinetic), change = norm(force(stop, u + V(0) * stop * s.e, {}) - f);
    const bool nearly = stop > 0 && change + std::fabs(F(v) - s.kinetic) <= 1e-6L * std::fabs(s.kinetic - norm(f));
    if (!nearly || stop >= time_left()) return false;
    const bool on_one_line = f.x * w.y == f.y * w.x;
    advance(stop, stop / 2 * w);
    if (norm(f) < s.kinetic || (on_one_line && norm(f) <= s.limit)) {
      stick();
    } else {
      ++turns;
      begin_from_rest();
    }
    return true;
  }
};

int main() {
  try {
    const Scene scene(std::cin);
    Motion(scene).run();
  } catch (const std::exception& error) {
    std::cout << "failed " << error.what() << "\n";
    return 1;
  }
  return 0;
}
