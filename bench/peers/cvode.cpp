// SUNDIALS: CVODE (BDF, Adams) with its own root-finding and its dense linear solver; Jacobians are analytic.
//   cvode method=bdf|adams formulation=polar|printed|smoothed rtol=… [v_cut=…] [v_s=…] [limit=…]
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

class Peer {
 public:
  explicit Peer(const scene::Options& options)
      : equations{options.text("formulation", "polar") == "polar", options.number("v_s", 0)} {
    const double rtol = options.number("rtol", 1e-6);
    SUNContext context = nullptr;
    SUNContext_Create(nullptr, &context);
    y = N_VNew_Serial(4, context);
    const N_Vector absolute = N_VNew_Serial(4, context);
    const State& scale = equations.polar ? scene::polar_scale : scene::cartesian_scale;
    for (int i = 0; i < 4; ++i) NV_Ith_S(absolute, i) = rtol * scale[i];
    const SUNMatrix matrix = SUNDenseMatrix(4, 4, context);
    memory = CVodeCreate(options.text("method", "bdf") == "bdf" ? CV_BDF : CV_ADAMS, context);
    CVodeInit(memory, rhs, 0, y);
    CVodeSetUserData(memory, &equations);
    CVodeSetErrHandlerFn(memory, silent, nullptr);
    CVodeSVtolerances(memory, rtol, absolute);
    CVodeSetLinearSolver(memory, SUNLinSol_Dense(y, matrix, context), matrix);
    CVodeSetJacFn(memory, jacobian);
    CVodeSetMaxNumSteps(memory, -1);
    int falling = -1;
    if (equations.polar) {
      CVodeRootInit(memory, 1, above_cut);
      CVodeSetRootDirection(memory, &falling);
      CVodeSetNoInactiveRootWarn(memory);
    }
  }

  void slip(State& state, double first_step, double cut, scene::Record& record) {
    equations.cut = cut;
    equations.v_floor = scene::floor_share * cut;
    advance(state, first_step, record);
  }

  void integrate(State state, scene::Record& record) { advance(state, 1e-12, record); }

 private:
  Equations equations;
  N_Vector y;
  void* memory;

  void advance(State& state, double first_step, scene::Record& record) {
    std::copy(state.begin(), state.end(), N_VGetArrayPointer(y));
    CVodeReInit(memory, record.time, y);
    CVodeSetInitStep(memory, first_step);
    while (!record.finished()) {
      CVodeSetStopTime(memory, record.next_sample());
      int flag;
      do {
        flag = CVode(memory, scene::t_end, y, &record.time, CV_ONE_STEP);
        record.step();
      } while (flag == CV_SUCCESS);
      if (flag < 0) throw std::runtime_error(CVodeGetReturnFlagName(flag));
      std::copy_n(N_VGetArrayPointer(y), 4, state.begin());
      if (flag == CV_ROOT_RETURN) return;
      record.sample(state);
    }
  }
};

int main(int argc, char** argv) {
  const scene::Options options(argc, argv);
  Peer peer(options);
  scene::run(peer, options);
}
