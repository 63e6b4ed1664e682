// SUNDIALS: CVODE (BDF, Adams) and ARKODE (DIRK, ERK), each with its own root-finding; dense Jacobians are analytic.
//   sundials method=bdf|adams|dirk|erk [order=…] formulation=polar|printed|smoothed rtol=… [v_cut=…] [v_s=…] [limit=…]
#include <arkode/arkode_arkstep.h>
#include <cvode/cvode.h>
#include <nvector/nvector_serial.h>
#include <sunlinsol/sunlinsol_dense.h>
#include <sunmatrix/sunmatrix_dense.h>

#include "scene.hpp"

using scene::State;

struct Equations {
  bool polar;
  double v_s, v_floor = 0, cut = 0;
};

extern "C" {
static int rhs(realtype, N_Vector y, N_Vector dy, void* data) {
  const auto& equations = *static_cast<Equations*>(data);
  if (equations.polar)
    scene::polar_rhs(N_VGetArrayPointer(y), N_VGetArrayPointer(dy), equations.v_floor);
  else
    scene::cartesian_rhs(N_VGetArrayPointer(y), N_VGetArrayPointer(dy), equations.v_s);
  return 0;
}

static int jacobian(realtype, N_Vector y, N_Vector, SUNMatrix matrix, void* data, N_Vector, N_Vector, N_Vector) {
  const auto& equations = *static_cast<Equations*>(data);
  const auto entry = [&](int i, int j) -> double& { return SM_ELEMENT_D(matrix, i, j); };
  if (equations.polar)
    scene::polar_jacobian(N_VGetArrayPointer(y), entry, equations.v_floor);
  else
    scene::cartesian_jacobian(N_VGetArrayPointer(y), entry, equations.v_s);
  return 0;
}

static int above_cut(realtype, N_Vector y, realtype* value, void* data) {
  value[0] = NV_Ith_S(y, 2) - static_cast<Equations*>(data)->cut;
  return 0;
}

static void silent(int, const char*, const char*, char*, void*) {}
}

// What CVODE and ARKODE share: context, vectors, and the order of calls.
class Peer {
 public:
  explicit Peer(const scene::Options& options)
      : equations{options.text("formulation", "polar") == "polar", options.number("v_s", 0)},
        rtol(options.number("rtol", 1e-6)), order(static_cast<int>(options.number("order", 0))) {
    SUNContext_Create(nullptr, &context);
    y = N_VNew_Serial(4, context);
    absolute = N_VNew_Serial(4, context);
    const State& scale = equations.polar ? scene::polar_scale : scene::cartesian_scale;
    for (int i = 0; i < 4; ++i) NV_Ith_S(absolute, i) = rtol * scale[i];
    matrix = SUNDenseMatrix(4, 4, context);
    linear = SUNLinSol_Dense(y, matrix, context);
  }
  virtual ~Peer() {
    SUNLinSolFree(linear);
    SUNMatDestroy(matrix);
    N_VDestroy(absolute);
    N_VDestroy(y);
    SUNContext_Free(&context);
  }

  void slip(State& state, double first_step, double cut, scene::Record& record) {
    equations.cut = cut;
    equations.v_floor = scene::floor_share * cut;
    advance(state, first_step, record);
  }

  void integrate(State state, scene::Record& record) { advance(state, 1e-12, record); }

 protected:
  Equations equations;
  double rtol;
  int order;
  SUNContext context = nullptr;
  N_Vector y = nullptr, absolute = nullptr;
  SUNMatrix matrix = nullptr;
  SUNLinearSolver linear = nullptr;

  virtual void restart(double time, double first_step) = 0;
  virtual void stop_at(double time) = 0;
  virtual int step(double& time) = 0;
  virtual std::string name(int flag) const = 0;
  enum { root = CV_ROOT_RETURN, stopped = CV_TSTOP_RETURN };
  static_assert(CV_ROOT_RETURN == ARK_ROOT_RETURN && CV_TSTOP_RETURN == ARK_TSTOP_RETURN);

 private:
  void advance(State& state, double first_step, scene::Record& record) {
    std::copy(state.begin(), state.end(), N_VGetArrayPointer(y));
    restart(record.time, first_step);
    while (!record.finished()) {
      stop_at(record.next_sample());
      int flag;
      do {
        flag = step(record.time);
        record.step();
      } while (flag == CV_SUCCESS);
      if (flag < 0) throw std::runtime_error(name(flag));
      std::copy_n(N_VGetArrayPointer(y), 4, state.begin());
      if (flag == root) return;
      record.sample(state);
    }
  }
};

class Cvode : public Peer {
 public:
  Cvode(const scene::Options& options, int method) : Peer(options), memory(CVodeCreate(method, context)) {
    CVodeInit(memory, rhs, 0, y);
    CVodeSetUserData(memory, &equations);
    CVodeSetErrHandlerFn(memory, silent, nullptr);
    CVodeSVtolerances(memory, rtol, absolute);
    CVodeSetLinearSolver(memory, linear, matrix);
    CVodeSetJacFn(memory, jacobian);
    CVodeSetMaxNumSteps(memory, -1);
    if (order > 0) CVodeSetMaxOrd(memory, order);
    int falling = -1;
    if (equations.polar) {
      CVodeRootInit(memory, 1, above_cut);
      CVodeSetRootDirection(memory, &falling);
      CVodeSetNoInactiveRootWarn(memory);
    }
  }
  ~Cvode() override { CVodeFree(&memory); }

 private:
  void* memory;

  void restart(double time, double first_step) override {
    CVodeReInit(memory, time, y);
    CVodeSetInitStep(memory, first_step);
  }
  void stop_at(double time) override { CVodeSetStopTime(memory, time); }
  int step(double& time) override { return CVode(memory, scene::t_end, y, &time, CV_ONE_STEP); }
  std::string name(int flag) const override { return CVodeGetReturnFlagName(flag); }
};

class Arkode : public Peer {
 public:
  Arkode(const scene::Options& options, bool implicit)
      : Peer(options), memory(ARKStepCreate(implicit ? nullptr : rhs, implicit ? rhs : nullptr, 0, y, context)) {
    ARKStepSetUserData(memory, &equations);
    ARKStepSetErrHandlerFn(memory, silent, nullptr);
    ARKStepSVtolerances(memory, rtol, absolute);
    if (implicit) {
      ARKStepSetLinearSolver(memory, linear, matrix);
      ARKStepSetJacFn(memory, jacobian);
      ARKStepSetDeduceImplicitRhs(memory, 1);
    }
    ARKStepSetMaxNumSteps(memory, -1);
    if (order > 0) ARKStepSetOrder(memory, order);
    if (order == 5 && !implicit)
      ARKStepSetTableNum(memory, ARKODE_DIRK_NONE, ARKODE_DORMAND_PRINCE_7_4_5);
    int falling = -1;
    if (equations.polar) {
      ARKStepRootInit(memory, 1, above_cut);
      ARKStepSetRootDirection(memory, &falling);
      ARKStepSetNoInactiveRootWarn(memory);
    }
  }
  ~Arkode() override { ARKStepFree(&memory); }

 private:
  void* memory;

  void restart(double time, double first_step) override {
    ARKStepReset(memory, time, y);
    ARKStepSetInitStep(memory, first_step);
  }
  void stop_at(double time) override { ARKStepSetStopTime(memory, time); }
  int step(double& time) override { return ARKStepEvolve(memory, scene::t_end, y, &time, ARK_ONE_STEP); }
  std::string name(int flag) const override { return ARKStepGetReturnFlagName(flag); }
};

int main(int argc, char** argv) {
  const scene::Options options(argc, argv);
  const std::string method = options.text("method", "bdf");
  if (method == "bdf" || method == "adams") {
    Cvode peer(options, method == "bdf" ? CV_BDF : CV_ADAMS);
    scene::run(peer, options);
  } else {
    Arkode peer(options, method == "dirk");
    scene::run(peer, options);
  }
}
