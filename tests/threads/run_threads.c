/* Runs in eight threads at once, for the thread sanitizer: decks are read under a lock, as under Python's, and runs advance
   without one. Prints what is wrong and exits with 1. `-` as argument leaves the lock out: then races must be found. */
#include <pthread.h>
#include <stdio.h>
#include <string.h>

/* src/python_api.f90, under gfortran's names. */
void __dst_python_api_MOD_run_open(const int *n_deck, const int *deck, const int *n_name, const int *name, const int *n_settings,
                                   const int *settings, long long *handle, int *status);
void __dst_python_api_MOD_run_advance(const long long *handle, const double *seconds, const double *until,
                                      int *finished, int *reached, int *n_rows, int *n_events);
void __dst_python_api_MOD_run_outcome(const long long *handle, int *status);
void __dst_python_api_MOD_run_close(const long long *handle);

enum { threads = 8, longest = 400 };

static const char deck[] = "&scene t_end = 0.1 / &system mass = 0.25, stiffness_x = 1e3, stiffness_y = 1e7, misalignment_deg = 5 / "
                           "&friction mu_0 = 0.2, mu_inf = 0.15, v_f = 0.01, normal_load = 10 / "
                           "&drive velocity = 1e-3 / &initial velocity_ratio = 1e-6 /";
static const char *const settings[] = {"integrator.method=radau5", "integrator.method=radau9", "integrator.method=radau13",
                                       "integrator.method=dopri5", "integrator.method=dop853",
                                       "integrator.method=moreau_jean\nintegrator.step=1e-5", "integrator.max_steps=100"};
static pthread_mutex_t lock = PTHREAD_MUTEX_INITIALIZER;
static int with_lock = 1;

static int spread(const char *text, int *codes) {
  const int n = (int)strlen(text);
  for (int i = 0; i < n; ++i) codes[i] = (unsigned char)text[i];
  return n;
}

/* Thread number `which`; its last status goes to the caller. */
static void *run(void *which) {
  int deck_codes[longest], name_codes[longest], setting_codes[longest];
  const int n_deck = spread(deck, deck_codes), n_name = spread("deck", name_codes);
  const int n_settings = spread(settings[*(int *)which % 7], setting_codes);
  const double slice = 0.02, until = 1e300;
  long long handle;
  int status, finished = 0, reached, n_rows, n_events;

  if (with_lock) pthread_mutex_lock(&lock);
  __dst_python_api_MOD_run_open(&n_deck, deck_codes, &n_name, name_codes, &n_settings, setting_codes, &handle, &status);
  if (with_lock) pthread_mutex_unlock(&lock);
  while (status == 0 && !finished)
    __dst_python_api_MOD_run_advance(&handle, &slice, &until, &finished, &reached, &n_rows, &n_events);
  if (status == 0) __dst_python_api_MOD_run_outcome(&handle, &status);
  if (with_lock) pthread_mutex_lock(&lock);
  __dst_python_api_MOD_run_close(&handle);
  if (with_lock) pthread_mutex_unlock(&lock);
  *(int *)which = status;
  return NULL;
}

int main(int count, char **arguments) {
  enum { too_many_steps = 42 };
  pthread_t thread[threads];
  int number[threads], wrong = 0;

  with_lock = !(count > 1 && strcmp(arguments[1], "-") == 0);
  for (int i = 0; i < threads; ++i) {
    number[i] = i;
    if (pthread_create(&thread[i], NULL, run, &number[i]) != 0) return 1;
  }
  for (int i = 0; i < threads; ++i) {
    pthread_join(thread[i], NULL);
    if (number[i] == (i % 7 == 6 ? too_many_steps : 0)) continue;
    printf("thread %d ended with %d\n", i, number[i]);
    wrong = 1;
  }
  return wrong;
}
