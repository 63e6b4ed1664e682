// An independent reference for the full model with the exact contact (docs/equations.md):
//
//     u' = V(t) e - w,     m w' = K u - F(v) w/v,     v = |w|,     F(v) = [mu_inf + (mu_0 - mu_inf) exp(-v/v_f)] W,
//
// at rest while |K u| <= F_0. It shares no code with src/ and takes another way:
//
// * the unknown is the Cartesian slip velocity w, not (v, theta); Radau IIA collocation of 12 stages (or as many as asked for);
// * numbers are 80-bit long doubles (-DQUADRUPLE: __float128 with libquadmath);
// * a step is judged by what its polynomial leaves of the equations between all the nodes, and by how far w turns between
//   them: no friction peak and no stop hides between two stages. No step is longer than half a period of the fast oscillation;
// * slip begins with two terms of its series over 1e-6 of the shortest time of the scene, and ends by steps that take 0.8 of
//   the time that is left, down to 1e-10 of the largest speed since the release;
// * samples are ends of steps, so there is no interpolation.
//
// Input (stdin): lines "key values...". Output (stdout): "sample t u_x u_y w_x w_y X theta sticking V", "event t kind gap"
// (kind 1: a rest begins, with |K u| a share `gap` below F_0; 2: slip begins), "dip t v peak" (a minimum of v below 1e-2 of the
// largest speed since the release that is no stop), "note key value".
// g++ -O2 -std=c++17 reference.cpp -o reference [-DQUADRUPLE -lquadmath]

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <iostream>
#include <sstream>
#include <stdexcept>
#include <string>
#include <vector>

#ifdef QUADRUPLE
#include <quadmath.h>
using real = __float128;
static real sqrt_(real x) { return sqrtq(x); }
static real exp_(real x) { return expq(x); }
static real sin_(real x) { return sinq(x); }
static real cos_(real x) { return cosq(x); }
static real atan2_(real y, real x) { return atan2q(y, x); }
static real abs_(real x) { return fabsq(x); }
static real pow_(real x, real y) { return powq(x, y); }
static real parse(const char* word) { return strtoflt128(word, nullptr); }
static const real epsilon = FLT128_EPSILON;
static const real pi = M_PIq;
static std::string text(real x) {
  char buffer[64];
  quadmath_snprintf(buffer, sizeof buffer, "%.34Qg", x);
  return buffer;
}
#else
using real = long double;
static real sqrt_(real x) { return std::sqrt(x); }
static real exp_(real x) { return std::exp(x); }
static real sin_(real x) { return std::sin(x); }
static real cos_(real x) { return std::cos(x); }
static real atan2_(real y, real x) { return std::atan2(y, x); }
static real abs_(real x) { return std::fabs(x); }
static real pow_(real x, real y) { return std::pow(x, y); }
static real parse(const char* word) { return std::strtold(word, nullptr); }
static const real epsilon = 1.0842021724855044340e-19L;
static const real pi = 3.141592653589793238462643383279502884L;
static std::string text(real x) {
  char buffer[64];
  std::snprintf(buffer, sizeof buffer, "%.21Lg", x);
  return buffer;
}
#endif

struct vec {
  real x = 0, y = 0;
};
static vec operator+(vec a, vec b) { return {a.x + b.x, a.y + b.y}; }
static vec operator-(vec a, vec b) { return {a.x - b.x, a.y - b.y}; }
static vec operator*(real s, vec a) { return {s * a.x, s * a.y}; }
static real dot(vec a, vec b) { return a.x * b.x + a.y * b.y; }
static real norm(vec a) {
  const real big = std::max(abs_(a.x), abs_(a.y));
  if (!(big > 0)) return 0;
  const vec b = {a.x / big, a.y / big};
  return big * sqrt_(dot(b, b));
}
static vec left(vec a) { return {-a.y, a.x}; }

// ---------------------------------------------------------------------------------------------------------- the scene

struct Scene {
  real m = 0, kx = 0, ky = 0, phi_deg = 0, mu0 = 0, mu_inf = 0, vf = 1, load = 0, ratio = 0;
  vec u0;
  std::vector<real> knot, velocity;  // of the drive; constant after the last
  real t_end = 0;
  std::vector<real> samples;
  int stages = 12;
  real tolerance = 1e-12L;
  long max_steps = 1000000;

  vec e;
  real limit = 0;  // F_0

  void prepare() {
    const real phi = phi_deg * pi / 180;
    e = {cos_(phi), sin_(phi)};
    limit = mu0 * load;
    samples.push_back(t_end);
    std::sort(samples.begin(), samples.end());
    samples.erase(std::unique(samples.begin(), samples.end()), samples.end());
  }
  vec force(vec u) const { return {kx * u.x, ky * u.y}; }
  real friction(real v) const { return (mu_inf + (mu0 - mu_inf) * exp_(-v / vf)) * load; }
  real slope(real v) const { return -(mu0 - mu_inf) / vf * exp_(-v / vf) * load; }
};

static Scene read_scene(std::istream& in) {
  Scene s;
  std::string line;
  bool decimal = false;  // 0.2 as it is written, and not the double beside it, which is what the package gets
  while (std::getline(in, line)) {
    std::istringstream words(line);
    std::string key, word;
    if (!(words >> key)) continue;
    std::vector<real> values;
    while (words >> word) values.push_back(decimal ? parse(word.c_str()) : static_cast<real>(std::strtod(word.c_str(), nullptr)));
    if (values.empty()) throw std::runtime_error("no value for " + key);
    const real value = values[0];
    if (key == "mass") s.m = value;
    else if (key == "stiffness_x") s.kx = value;
    else if (key == "stiffness_y") s.ky = value;
    else if (key == "misalignment_deg") s.phi_deg = value;
    else if (key == "mu_0") s.mu0 = value;
    else if (key == "mu_inf") s.mu_inf = value;
    else if (key == "v_f") s.vf = value;
    else if (key == "normal_load") s.load = value;
    else if (key == "velocity_ratio") s.ratio = value;
    else if (key == "elongation_x") s.u0.x = value;
    else if (key == "elongation_y") s.u0.y = value;
    else if (key == "time") s.knot = values;
    else if (key == "velocity") s.velocity = values;
    else if (key == "t_end") s.t_end = value;
    else if (key == "samples") s.samples = values;
    else if (key == "stages") s.stages = static_cast<int>(value);
    else if (key == "tolerance") s.tolerance = value;
    else if (key == "decimal") decimal = value != 0;
    else if (key == "max_steps") s.max_steps = static_cast<long>(value);
    else throw std::runtime_error("unknown key " + key);
  }
  if (s.knot.empty()) s.knot = {0};
  s.prepare();
  return s;
}

// One linear piece of V(t).
struct Piece {
  real start, end, velocity, acceleration;
  real at(real t) const { return velocity + acceleration * (t - start); }
  // D(t + d) - D(t)
  real travel(real t, real d) const { return d * (at(t) + acceleration * d / 2); }
};

static std::vector<Piece> pieces_of(const Scene& s) {
  std::vector<Piece> pieces;
  for (size_t i = 0; i < s.knot.size(); ++i) {
    const bool last = i + 1 == s.knot.size();
    if (s.knot[i] >= s.t_end) break;
    const real end = last ? s.t_end : s.knot[i + 1];
    if (end <= s.knot[i]) continue;
    pieces.push_back({s.knot[i], std::min(end, s.t_end), s.velocity[i], last ? 0 : (s.velocity[i + 1] - s.velocity[i]) / (end - s.knot[i])});
  }
  return pieces;
}

// ----------------------------------------------------------------------------------------------- the collocation method

static std::array<real, 2> legendre(int n, real x) {  // P_n, P_{n-1}
  real before = 1, now = x;
  if (n == 0) return {1, 0};
  for (int k = 2; k <= n; ++k) {
    const real next = ((2 * k - 1) * x * now - (k - 1) * before) / k;
    before = now;
    now = next;
  }
  return {now, before};
}

// Zeros of a function on (-1, 1), from a fine grid by bisection.
template <class Function>
static std::vector<real> zeros(Function f) {
  std::vector<real> found;
  const int cells = 4000;
  auto grid = [&](int i) { return -cos_(pi * (i + real(1) / 3) / (cells + 1)); };
  for (int i = 0; i < cells; ++i) {
    real a = grid(i), b = grid(i + 1), fa = f(a);
    if ((fa > 0) == (f(b) > 0)) continue;
    for (int k = 0; k < 130; ++k) {
      const real c = (a + b) / 2, fc = f(c);
      if ((fc > 0) == (fa > 0)) a = c, fa = fc;
      else b = c;
    }
    found.push_back((a + b) / 2);
  }
  return found;
}

struct Method {
  int s;
  std::vector<real> c;                       // nodes on (0, 1], the last is 1
  std::vector<std::vector<real>> a, d;       // integrals; derivatives of the polynomial through (0, 0) and the nodes
  std::vector<real> probe;                   // points between the nodes
  std::vector<std::vector<real>> at, rate, integral;  // at the probes: value and derivative (with the start as column 0), integral
  std::vector<std::vector<real>> end_rate;   // first three derivatives at the end (column 0: start)

  explicit Method(int stages) : s(stages) {
    auto radau = [&](real x) {
      const auto p = legendre(s, x);
      return p[0] - p[1];
    };
    std::vector<real> root = zeros(radau);
    while (static_cast<int>(root.size()) >= s) root.pop_back();  // 1 itself may be found by roundoff
    for (real x : root) c.push_back((1 + x) / 2);
    c.push_back(1);
    if (static_cast<int>(c.size()) != s) throw std::runtime_error("nodes");
    std::vector<real> gauss = zeros([&](real x) { return legendre(s, x)[0]; }), weight;
    for (real x : gauss) {
      const auto p = legendre(s, x);
      const real slope = s * (x * p[0] - p[1]) / (x * x - 1);
      weight.push_back(2 / ((1 - x * x) * slope * slope));
    }
    std::vector<real> full = {0};
    full.insert(full.end(), c.begin(), c.end());
    auto integrals = [&](real end) {
      std::vector<real> row(s, 0);
      for (size_t g = 0; g < gauss.size(); ++g)
        for (int j = 0; j < s; ++j) row[j] += weight[g] * end / 2 * basis(c, j, end * (1 + gauss[g]) / 2);
      return row;
    };
    for (int i = 0; i < s; ++i) {
      a.push_back(integrals(c[i]));
      std::vector<real> row;
      for (int j = 1; j <= s; ++j) row.push_back(node_rate(full, j, i + 1));
      d.push_back(row);
    }
    real before = 0;
    for (int i = 0; i < s; ++i) {
      for (real share : {real(1) / 3, real(2) / 3}) {
        const real tau = before + share * (c[i] - before);
        probe.push_back(tau);
        std::vector<real> value, slope;
        for (int j = 0; j <= s; ++j) {
          value.push_back(basis(full, j, tau));
          real sum = 0;
          for (int k = 0; k <= s; ++k)
            if (k != j) sum += 1 / (tau - full[k]);
          slope.push_back(value.back() * sum);
        }
        at.push_back(value);
        rate.push_back(slope);
        integral.push_back(integrals(tau));
      }
      before = c[i];
    }
    // Derivatives at the end by repeated differentiation at the nodes.
    std::vector<std::vector<real>> matrix(s + 1, std::vector<real>(s + 1));
    for (int i = 0; i <= s; ++i)
      for (int j = 0; j <= s; ++j) matrix[i][j] = node_rate(full, j, i);
    std::vector<real> row(s + 1, 0);
    row[s] = 1;
    for (int order = 1; order <= 3; ++order) {
      std::vector<real> next(s + 1, 0);
      for (int i = 0; i <= s; ++i)
        for (int j = 0; j <= s; ++j) next[j] += row[i] * matrix[i][j];
      row = next;
      end_rate.push_back(row);
    }
  }

  static real basis(const std::vector<real>& node, int j, real x) {
    real product = 1;
    for (int k = 0; k < static_cast<int>(node.size()); ++k)
      if (k != j) product *= (x - node[k]) / (node[j] - node[k]);
    return product;
  }
  // Derivative of the basis function j at the node i.
  static real node_rate(const std::vector<real>& node, int j, int i) {
    const int n = static_cast<int>(node.size());
    if (i == j) {
      real sum = 0;
      for (int k = 0; k < n; ++k)
        if (k != j) sum += 1 / (node[j] - node[k]);
      return sum;
    }
    real product = 1 / (node[j] - node[i]);
    for (int k = 0; k < n; ++k)
      if (k != i && k != j) product *= (node[i] - node[k]) / (node[j] - node[k]);
    return product;
  }
};

// ------------------------------------------------------------------------------------------------------------ the motion

static bool solve(std::vector<real>& matrix, std::vector<real>& right, int n) {
  for (int k = 0; k < n; ++k) {
    int pivot = k;
    for (int i = k + 1; i < n; ++i)
      if (abs_(matrix[i * n + k]) > abs_(matrix[pivot * n + k])) pivot = i;
    if (!(abs_(matrix[pivot * n + k]) > 0)) return false;
    if (pivot != k) {
      for (int j = k; j < n; ++j) std::swap(matrix[pivot * n + j], matrix[k * n + j]);
      std::swap(right[pivot], right[k]);
    }
    const real inverse = 1 / matrix[k * n + k];
    for (int i = k + 1; i < n; ++i) {
      const real factor = matrix[i * n + k] * inverse;
      if (factor == 0) continue;
      for (int j = k + 1; j < n; ++j) matrix[i * n + j] -= factor * matrix[k * n + j];
      right[i] -= factor * right[k];
    }
  }
  for (int k = n - 1; k >= 0; --k) {
    for (int j = k + 1; j < n; ++j) right[k] -= matrix[k * n + j] * right[j];
    right[k] /= matrix[k * n + k];
  }
  return true;
}

class Motion {
 public:
  explicit Motion(const Scene& scene) : s(scene), method(scene.stages), pieces(pieces_of(scene)), stage(method.s) {
    fast = sqrt_(s.m / std::max(s.kx, s.ky));
    u = s.u0;
    X = -dot(u, s.e);
  }

  void run() {
    w = s.ratio * s.velocity[0] * s.e;
    sample();  // t = 0
    if (norm(w) > 0) {
      begin_at_speed();
    } else if (!stays()) {
      begin_from_rest();
    } else {
      stick();
    }
    while (t < s.t_end) {
      while (t >= pieces[piece].end && piece + 1 < pieces.size()) {
        ++piece;
        has_polynomial = false;
        // A corner of V is a corner of w'': begin again with short steps.
        h = std::min(h, fast / 8);
      }
      if (sticking) rest();
      else slide();
      if (++rounds > 50 * s.max_steps) throw std::runtime_error("too many rounds");
    }
    std::cout << "note sticks " << sticks << "\nnote shortest_rest " << text(shortest_rest) << "\nnote nearest_limit " << text(nearest_limit)
              << "\nnote smallest_dip " << text(smallest_dip) << "\nnote fades " << fades << "\nnote turns " << turns << "\nnote fastest " << text(fastest) << "\nnote steps " << steps
              << "\nnote rejected " << rejected << "\nnote least_release " << text(least_release) << "\n";
  }

 private:
  const Scene& s;
  Method method;
  std::vector<Piece> pieces;
  std::vector<vec> stage;            // w at the nodes
  size_t piece = 0, next_sample = 0;
  real t = 0, X = 0, fast = 0;
  vec u, w;
  bool sticking = false;
  real h = 0;                        // the next step
  real peak = 0, fastest = 0;        // largest speed since the release, and of the run
  real rest_began = 0;
  // The polynomial of the last step, for the first guess.
  bool has_polynomial = false;
  real last_h = 0;
  vec last_w0;
  std::vector<vec> last_stage;
  // The series of a release, for the first guess.
  vec series[4];
  // v before, for minima
  real speed_before = 0, speed_now = 0;
  long sticks = 0, steps = 0, rejected = 0, rounds = 0, fades = 0, turns = 0;
  real shortest_rest = 1e300L, nearest_limit = 1, smallest_dip = 1e300L, least_release = 1e300L;

  real V(real time) const { return pieces[piece].at(time); }
  real horizon() const {
    real end = pieces[piece].end;
    if (next_sample < s.samples.size()) end = std::min(end, s.samples[next_sample]);
    return end;
  }

  void event(int kind, real gap = 0) { std::cout << "event " << text(t) << " " << kind << " " << text(gap) << "\n"; }

  void sample() {
    while (next_sample < s.samples.size() && s.samples[next_sample] <= t) {
      const vec f = s.force(u);
      const vec direction = sticking ? f : (norm(w) > 0 ? w : f);
      std::cout << "sample " << text(s.samples[next_sample]) << " " << text(u.x) << " " << text(u.y) << " " << text(w.x) << " " << text(w.y) << " "
                << text(X) << " " << text(norm(direction) > 0 ? atan2_(direction.y, direction.x) : real(0)) << " " << sticking << " "
                << text(pieces.empty() ? s.velocity[0] : V(t)) << "\n";
      ++next_sample;
    }
  }

  // ---- rest

  // Whether an object at rest stays: below the limit, or at it and not pulled further out.
  bool stays() const {
    const vec f = s.force(u);
    const real size = norm(f);
    if (size < s.limit * (1 - 16 * epsilon)) return true;
    if (size > s.limit * (1 + 16 * epsilon)) return false;
    return V(t) * dot(s.force(s.e), f) <= 0 && s.limit > 0;
  }

  void stick() {
    sticking = true;
    w = {};
    ++sticks;
    rest_began = t;
    const real gap = s.limit > 0 ? 1 - norm(s.force(u)) / s.limit : 0;
    nearest_limit = std::min(nearest_limit, gap);
    event(1, gap);
  }

  // To the release, the end of the piece, or the next sample.
  void rest() {
    const Piece& p = pieces[piece];
    const real duration = horizon() - t;
    real release = first_release(p, duration);
    const bool released = release < duration;
    const real d = released ? release : duration;
    u = u + p.travel(t, d) * s.e;
    t = released ? t + d : horizon();
    if (!released) {
      sample();
      return;
    }
    shortest_rest = std::min(shortest_rest, t - rest_began);
    event(2);
    begin_from_rest();
  }

  // Delay until |K(u + D e)| = F_0, or more than `duration`.
  real first_release(const Piece& p, real duration) const {
    const vec g = s.force(s.e), f = s.force(u);
    // |g|^2 D^2 + 2 g.f D - (F_0^2 - |f|^2) = 0
    const real a = dot(g, g), b = dot(g, f), size = norm(f);
    const real gap = std::max(real(0), (s.limit - size) * (s.limit + size));
    const real root = sqrt_(b * b + a * gap);
    const real ahead = b > 0 ? gap / (b + root) : (root - b) / a;
    const real behind = b > 0 ? -(b + root) / a : -gap / (root - b);
    const real never = 2 * duration + 1;
    auto reach = [&](real goal) -> real {  // first d >= 0 with travel(t, d) = goal
      real v = p.at(t), q = p.acceleration;
      if (goal < 0) goal = -goal, v = -v, q = -q;
      if (goal == 0 && v > 0) return 0;
      const real under = v * v + 2 * q * goal;
      if (under < 0) return never;
      const real r = sqrt_(under);
      if (v >= 0) return v + r > 0 ? 2 * goal / (v + r) : never;
      return q > 0 ? (r - v) / q : never;
    };
    return std::min(reach(ahead), b == 0 && gap == 0 ? never : reach(behind));
  }

  // ---- beginnings

  void begin_from_rest() {
    sticking = false;
    const vec f = s.force(u);
    const vec n = (1 / norm(f)) * f, side = left(n);
    const real V0 = V(t), q = pieces[piece].acceleration;
    const vec g = V0 * s.force(s.e);
    real b = (norm(f) - s.limit) / s.m;
    if (b * s.m < 64 * epsilon * s.limit) b = 0;
    // w = v n(theta): m (v' theta') = g.side - (f.n) theta'; m v'' = g.n - F'(0) v'
    const real turn = dot(g, side) / (norm(f) + s.m * b);
    const real jerk = (dot(g, n) - s.slope(0) * b) / s.m;
    // The shortest time of the scene.
    real unit = fast;
    auto shorten = [&](real x) {
      if (x > 0) unit = std::min(unit, x);
    };
    shorten(s.limit / norm(g));
    if (abs_(s.slope(0)) > 0) shorten(s.m / abs_(s.slope(0)));
    if (b > 0) shorten(s.vf / b), shorten(b / abs_(jerk));
    if (jerk > 0) shorten(sqrt_(2 * s.vf / jerk));
    if (abs_(q) > 0) shorten(abs_(V0 / q));
    const real noise = jerk > 0 && b == 0 ? 1000 * epsilon * s.limit / (s.m * jerk) : 0;
    const real d = std::min(std::max(real(1e-6L) * unit, noise), horizon() - t);
    // w = (b d + jerk d^2/2)(n + turn d side) + O(d^3)
    series[0] = {};
    series[1] = b * n;
    series[2] = jerk / 2 * n + b * turn * side;
    series[3] = jerk / 2 * turn * side;
    const vec slipped = d * d * (real(1) / 2 * series[1] + d * (real(1) / 3 * series[2] + d / 4 * series[3]));
    w = d * (series[1] + d * (series[2] + d * series[3]));
    u = u + pieces[piece].travel(t, d) * s.e - slipped;
    X += dot(slipped, s.e);
    t += d;
    peak = norm(w);
    least_release = std::min(least_release, dot(g, n) / std::max(norm(g), real(1e-300L)));
    // The series about the new place.
    series[1] = series[1] + 2 * d * series[2] + 3 * d * d * series[3];
    series[2] = series[2] + 3 * d * series[3];
    series[0] = w;
    has_polynomial = false;
    h = 2 * d;
    speed_before = speed_now = peak;
    if (t >= horizon()) sample();
  }

  void begin_at_speed() {
    sticking = false;
    const vec f = s.force(u);
    const real v = norm(w);
    series[0] = w;
    series[1] = (1 / s.m) * (f - (s.friction(v) / v) * w);
    series[2] = series[3] = {};
    h = std::min(fast / 100, s.m * v / (100 * (s.limit + norm(f) + s.mu_inf * s.load)));
    peak = v;
    has_polynomial = false;
    speed_before = speed_now = v;
  }

  // ---- slip

  vec polynomial(const std::vector<real>& row, vec start, const std::vector<vec>& values) const {
    vec sum = row[0] * start;
    for (int j = 0; j < method.s; ++j) sum = sum + row[j + 1] * values[j];
    return sum;
  }

  void guess(real step, bool whole) {
    if (has_polynomial && whole) {
      std::vector<real> node = {0};
      node.insert(node.end(), method.c.begin(), method.c.end());
      for (int i = 0; i < method.s; ++i) {
        const real tau = 1 + method.c[i] * step / last_h;
        std::vector<real> row;
        for (int j = 0; j <= method.s; ++j) row.push_back(Method::basis(node, j, tau));
        stage[i] = polynomial(row, last_w0, last_stage);
      }
      return;
    }
    for (int i = 0; i < method.s; ++i) {
      const real d = method.c[i] * step;
      stage[i] = w + d * (series[1] + d * (series[2] + d * series[3]));
    }
  }

  // Newton's method for the stages of a step.
  bool collocate(real step) {
    const int n = method.s;
    const Piece& p = pieces[piece];
    std::vector<real> matrix(4 * n * n), right(2 * n);
    std::vector<real> travel(n);
    for (int i = 0; i < n; ++i) travel[i] = p.travel(t, method.c[i] * step);
    const real per_mass = step / s.m;
    real eta_before = 1e30L;
    for (int iteration = 0; iteration < 15; ++iteration) {
      for (int i = 0; i < n; ++i) {
        const vec wi = stage[i];
        const real v = norm(wi);
        if (!(v > 0)) return false;
        vec slipped, change;
        for (int j = 0; j < n; ++j) {
          slipped = slipped + method.a[i][j] * stage[j];
          change = change + method.d[i][j] * (stage[j] - w);
        }
        const vec f = s.force(u + travel[i] * s.e - step * slipped);
        const vec direction = (1 / v) * wi, side = left(direction);
        const real F = s.friction(v);
        const vec residual = change - per_mass * (f - F * direction);
        right[i] = -residual.x;
        right[n + i] = -residual.y;
        for (int j = 0; j < n; ++j) {
          matrix[i * 2 * n + j] = method.d[i][j] + per_mass * step * s.kx * method.a[i][j];
          matrix[i * 2 * n + n + j] = 0;
          matrix[(n + i) * 2 * n + j] = 0;
          matrix[(n + i) * 2 * n + n + j] = method.d[i][j] + per_mass * step * s.ky * method.a[i][j];
        }
        const real along = per_mass * s.slope(v), across = per_mass * F / v;
        matrix[i * 2 * n + i] += along * direction.x * direction.x + across * side.x * side.x;
        matrix[i * 2 * n + n + i] += along * direction.x * direction.y + across * side.x * side.y;
        matrix[(n + i) * 2 * n + i] += along * direction.x * direction.y + across * side.x * side.y;
        matrix[(n + i) * 2 * n + n + i] += along * direction.y * direction.y + across * side.y * side.y;
      }
      if (!solve(matrix, right, 2 * n)) return false;
      real eta = 0, noise = 0, largest = 0;
      bool fine = true;
      for (int i = 0; i < n; ++i) {
        const vec change = {right[i], right[n + i]};
        const real v = norm(stage[i]);
        const real relative = norm(change) / v;
        if (!(relative < 1e30L)) return false;
        eta = std::max(eta, relative);
        largest = std::max(largest, v);
        noise = 64 * epsilon * (per_mass * s.limit);
        if (!(relative <= 1e-13L || norm(change) <= noise + 16 * epsilon * largest)) fine = false;
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

  // What the polynomial leaves of the equations between the nodes, as a share of the largest speed. -1: w turns too far. Also the place of
  // the smallest speed.
  real defect(real step, real& turn_at) {
    const int n = method.s;
    const Piece& p = pieces[piece];
    const size_t count = method.probe.size();
    std::vector<vec> value(count);
    real largest = norm(w), worst = 0;
    for (const vec& each : stage) largest = std::max(largest, norm(each));
    const real noise = 256 * epsilon * s.limit;
    vec before = w;
    for (size_t k = 0; k < count; ++k) {
      const vec at = polynomial(method.at[k], w, stage), rate = polynomial(method.rate[k], w, stage);
      vec slipped, plain;
      for (int j = 0; j < n; ++j) slipped = slipped + method.integral[k][j] * stage[j];
      const real v = norm(at);
      if (!turns_little(before, at, turn_at, method.probe[k])) return -1;
      before = at;
      if (k % 2 == 1) {
        const vec node = stage[k / 2];
        if (!turns_little(before, node, turn_at, method.probe[k])) return -1;
        before = node;
      }
      const real d = method.probe[k] * step;
      const vec f = s.force(u + p.travel(t, d) * s.e - step * slipped);
      const vec direction = (1 / v) * at, side = left(direction);
      const real F = s.friction(v);
      const vec open = (1 / s.m) * (f - F * direction) - (1 / step) * rate;
      const real floor = noise / s.m;
      const real along = std::max(real(0), abs_(dot(open, direction)) - floor);
      const real across = std::max(real(0), abs_(dot(open, side)) - floor) / (1 + step * F / (s.m * v));
      worst = std::max(worst, step * std::max(along, across) / largest);
    }
    return worst;
  }

  static bool turns_little(vec a, vec b, real& turn_at, real tau) {
    if (dot(a, b) >= 0.5L * norm(a) * norm(b)) return true;
    turn_at = tau;
    return false;
  }

  // Time until v = 0 from v, v', v'': -1 if it does not come to that.
  real time_to_stop() const {
    const real v = norm(w);
    const vec n = (1 / v) * w, side = left(n), f = s.force(u);
    const real a = (dot(f, n) - s.friction(v)) / s.m;
    const vec g = s.force(V(t) * s.e - w);
    const real across = dot(f, side);
    const real j = (dot(g, n) + across * across / (s.m * v) - s.slope(v) * a) / s.m;
    const real under = a * a - 2 * j * v;
    if (under < 0) return -1;
    if (a < 0) return 2 * v / (sqrt_(under) - a);
    return j < 0 ? (-a - sqrt_(under)) / j : real(-1);
  }

  void slide() {
    const real v = norm(w);
    peak = std::max(peak, v);
    const real stop = time_to_stop();
    const bool stopping = stop > 0 && v < 1e-10L * peak;
    if (stopping && finish(stop)) return;
    if (v < 1e-16L * peak && stays() && stop < 0) {
      ++fades;
      t = std::min(t, s.t_end);
      stick();
      return;
    }
    const real end = horizon() - t;
    real step = std::min(h, fast * pi);
    if (stop > 0) step = std::min(step, real(0.8L) * stop);
    bool to_end = false;
    if (step >= end * (1 - real(1e-12L))) step = end, to_end = true;
    else if (step > end / 2) step = end / 2;
    for (int attempt = 0;; ++attempt) {
      if (attempt > 200 || step < 1e-40L * s.t_end) throw std::runtime_error("step too short at t = " + text(t));
      bool good = false;
      for (bool whole : {true, false}) {
        if (whole && !(has_polynomial && step <= 2 * last_h)) continue;
        guess(step, whole);
        good = collocate(step);
        if (good) break;
      }
      real error = -2, turn_at = 1;
      if (good) error = defect(step, turn_at);
      if (good && error >= 0 && error <= s.tolerance) {
        accept(step, to_end, error);
        return;
      }
      ++rejected;
      real factor = 0.4L;
      if (good && error > 0) factor = std::min(real(0.8L), std::max(real(0.2L), real(0.85L) * pow_(s.tolerance / error, real(1) / method.s)));
      else if (good && error < 0) factor = std::min(real(0.7L), std::max(real(0.1L), real(0.9L) * turn_at));
      step *= factor;
      to_end = false;
    }
  }

  void accept(real step, bool to_end, real error) {
    const int n = method.s;
    if (++steps > s.max_steps) throw std::runtime_error("too many steps at t = " + text(t));
    vec slipped;
    for (int j = 0; j < n; ++j) slipped = slipped + method.a[n - 1][j] * stage[j];
    // Smallest speeds.
    for (size_t k = 0; k < method.probe.size(); ++k) {
      watch_minimum(norm(polynomial(method.at[k], w, stage)));
      if (k % 2 == 1) watch_minimum(norm(stage[k / 2]));
    }
    for (const vec& each : stage) peak = std::max(peak, norm(each));
    fastest = std::max(fastest, std::max(peak, norm(w)));
    for (int order = 1; order <= 3; ++order) {
      const real scale = (order == 1 ? 1 : order == 2 ? real(1) / 2 : real(1) / 6) / (order == 1 ? step : order == 2 ? step * step : step * step * step);
      series[order] = scale * polynomial(method.end_rate[order - 1], w, stage);
    }
    has_polynomial = true;
    last_h = step;
    last_w0 = w;
    last_stage = stage;
    u = u + pieces[piece].travel(t, step) * s.e - step * slipped;
    X += step * dot(slipped, s.e);
    w = stage[n - 1];
    t = to_end ? horizon() : t + step;
    const real growth = error > 0 ? real(0.85L) * pow_(s.tolerance / error, real(1) / method.s) : real(4);
    const real proposed = step * std::min(real(4), std::max(real(0.3L), growth));
    h = to_end ? std::max(h, proposed) : proposed;
    if (to_end) sample();
  }

  // A minimum of v that is no stop, as a share of the largest speed since the release.
  void watch_minimum(real v) {
    if (speed_now < speed_before && v >= speed_now && peak > 0) {
      smallest_dip = std::min(smallest_dip, speed_now / peak);
      if (speed_now < 1e-2L * peak) std::cout << "dip " << text(t) << " " << text(speed_now) << " " << text(peak) << "\n";
    }
    speed_before = speed_now;
    speed_now = v;
  }

  // The last 1e-10 of a stop with constant deceleration and direction.
  bool finish(real stop) {
    const real end = horizon() - t;
    const real d = std::min(stop, end);
    const vec start = w;
    const real share = d / stop;
    const vec slipped = d * (1 - share / 2) * start;
    const vec there = u + pieces[piece].travel(t, d) * s.e - slipped;
    u = there;
    X += dot(slipped, s.e);
    w = (1 - share) * start;
    t = stop <= end ? t + d : horizon();
    if (stop > end) {
      sample();
      has_polynomial = false;
      series[1] = (-1 / stop) * start;
      series[2] = series[3] = {};
      h = std::min(h, stop - end);
      return true;
    }
    w = {};
    if (stays()) {
      stick();
    } else {
      ++turns;
      begin_from_rest();
    }
    if (t >= horizon()) sample();
    return true;
  }
};

int main() {
  try {
    const Scene scene = read_scene(std::cin);
    Motion(scene).run();
  } catch (const std::exception& error) {
    std::cout << "failed " << error.what() << "\n";
    return 1;
  }
  return 0;
}
