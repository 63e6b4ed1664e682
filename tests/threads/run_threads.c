/* Runs in eight threads at once, and a sweep in four more, for the thread sanitizer: decks are read under a lock, as under
   Python's, and runs and cases advance without one. (A pthread driver, since the sanitizer does not know what OpenMP's
   library does.) Prints what is wrong and exits with 1. `-` as argument leaves the lock out: then races must be found. */
#include <pthread.h>
#include <stdio.h>
#include <string.h>

/* python/core/python_api.f90, under gfortran's names. */
void __dst_python_api_MOD_run_open(const int *n_deck, const int *deck, const int *n_name, const int *name, const int *n_settings,
                                   const int *settings, long long *handle, int *status);
void __dst_python_api_MOD_run_advance(const long long *handle, const double *seconds, const double *until,
                                      int *finished, int *reached, int *n_rows, int *n_events);
void __dst_python_api_MOD_run_outcome(const long long *handle, int *status);
void __dst_python_api_MOD_run_close(const long long *handle);
void __dst_python_api_MOD_sweep_open(const int *n_deck, const int *deck, const int *n_name, const int *name, const int *n_settings,
                                     const int *settings, const int *n_names, const int *names, const int *n_axes,
                                     const int *sizes, const int *n_values, const double *values, const int *is_list,
                                     long long *handle, int *cases, int *axes, int *status);
void __dst_python_api_MOD_sweep_sizes(const long long *handle, const int *i, int *n_axis, int *n_case, int *n_at_once, int *is_list);
void __dst_python_api_MOD_sweep_run(const long long *handle, const int *first, const int *n, const int *n_values, double *values,
                                    int *codes, int *messages);
void __dst_python_api_MOD_sweep_stop(const long long *handle);
void __dst_python_api_MOD_sweep_close(const long long *handle);

enum { threads = 8, sweep_threads = 4, pieces = 8, piece = 3, longest = 400, most_values = 64, message_length = 400, too_many_steps = 42, not_run = -1 };

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

/* A sweep of 24 cases in pieces of 3; every other case fails at its limit of steps, the last pieces are given up. */
static long long sweep;
static int n_values, next_piece;
static int codes[pieces][piece];

static int open_sweep(void) {
  static const double values[] = {1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 50, 0};
  const int sizes[] = {12, 2}, n_axes = 2, n_all = 14, no_list = 0, first_axis = 1;
  int deck_codes[longest], name_codes[longest], key_codes[longest], n_deck = spread(deck, deck_codes), n_name = spread("deck", name_codes);
  const int n_keys = spread("system.misalignment_deg\nintegrator.max_steps", key_codes), n_settings = 0;
  int status, cases, axes, ignored;

  __dst_python_api_MOD_sweep_open(&n_deck, deck_codes, &n_name, name_codes, &n_settings, key_codes, &n_keys, key_codes, &n_axes, sizes,
                                  &n_all, values, &no_list, &sweep, &cases, &axes, &status);
  if (status != 0 || cases != pieces * piece) return 1;
  __dst_python_api_MOD_sweep_sizes(&sweep, &first_axis, &ignored, &n_values, &ignored, &ignored);
  return n_values > most_values;
}

static void *run_pieces(void *nothing) {
  double values[piece * most_values];
  int messages[message_length * piece], number;

  while ((number = __atomic_fetch_add(&next_piece, 1, __ATOMIC_RELAXED)) < pieces) {
    const int first = number * piece + 1, n = piece;
    if (number == pieces - 2) __dst_python_api_MOD_sweep_stop(&sweep);
    __dst_python_api_MOD_sweep_run(&sweep, &first, &n, &n_values, values, codes[number], messages);
  }
  return nothing;
}

/* Pieces before the stop are whole, or cut by it; each case is done, or failed as it must. */
static int check_sweep(void) {
  int done = 0;

  for (int i = 0; i < pieces; ++i)
    for (int j = 0; j < piece; ++j) {
      if (codes[i][j] == not_run) continue;
      if (codes[i][j] != ((i * piece + j) % 2 == 0 ? too_many_steps : 0)) return 1;
      ++done;
    }
  return done < piece;
}

int main(int count, char **arguments) {
  pthread_t thread[threads + sweep_threads];
  int number[threads], wrong = 0;

  with_lock = !(count > 1 && strcmp(arguments[1], "-") == 0);
  if (open_sweep() != 0) return 1;
  for (int i = 0; i < threads + sweep_threads; ++i) {
    if (i < threads) number[i] = i;
    if (pthread_create(&thread[i], NULL, i < threads ? run : run_pieces, i < threads ? (void *)&number[i] : NULL) != 0) return 1;
  }
  for (int i = 0; i < threads + sweep_threads; ++i) pthread_join(thread[i], NULL);
  for (int i = 0; i < threads; ++i) {
    if (number[i] == (i % 7 == 6 ? too_many_steps : 0)) continue;
    printf("thread %d ended with %d\n", i, number[i]);
    wrong = 1;
  }
  if (check_sweep() != 0) {
    printf("the sweep has other cases than it should\n");
    wrong = 1;
  }
  __dst_python_api_MOD_sweep_close(&sweep);
  return wrong;
}
