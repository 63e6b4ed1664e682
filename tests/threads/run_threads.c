/* Runs in eight threads at once, and a sweep in four more, for the thread sanitizer: decks are read under a lock, as under
   Python's, and runs and cases advance without one. (A pthread driver, since the sanitizer does not know what OpenMP's
   library does.) Prints what is wrong and exits with 1. `-` as argument leaves the lock out: then races must be found. */
#include <pthread.h>
#include <stdio.h>
#include <string.h>

/* python/core/python_api.f90, under gfortran's names; the lengths of character arguments come last. */
void __dst_python_api_MOD_make(const char *what, const int *n_deck, const char *deck, const int *n_name, const char *name,
                               const int *n_settings, const char *settings, const int *n_words, const char *words, const int *n_numbers,
                               const double *numbers, long long *handle, int *status, size_t, size_t, size_t, size_t, size_t);
void __dst_python_api_MOD_proceed(const long long *handle, const double *seconds, const double *until,
                                  int *finished, int *reached, double *time, int *status);
void __dst_python_api_MOD_ask(const long long *handle, const char *which, int *n_bytes, int *n_columns, int *n_rows, size_t);
void __dst_python_api_MOD_sweep_run(const long long *handle, const int *first, const int *n, const int *n_values, const int *n_columns,
                                    const int *n_rows, double *values, double *cycles, int *counts, int *codes, char *messages, size_t);
void __dst_python_api_MOD_sweep_stop(const long long *handle);
void __dst_python_api_MOD_release(const long long *handle);

enum { threads = 8, sweep_threads = 4, pieces = 8, piece = 3, most_values = 64, message_length = 400, too_many_steps = 42, not_run = -1 };

static const char deck[] = "&scene t_end = 0.1 / &system mass = 0.25, stiffness_x = 1e3, stiffness_y = 1e7, misalignment_deg = 5 / "
                           "&friction mu_0 = 0.2, mu_inf = 0.15, v_f = 0.01, normal_load = 10 / "
                           "&drive velocity = 1e-3 / &initial velocity_ratio = 1e-6 /";
static const char *const settings[] = {"integrator.method=radau5", "integrator.method=radau9", "integrator.method=radau13",
                                       "integrator.method=dopri5", "integrator.method=dop853",
                                       "integrator.max_steps=100"};
static pthread_mutex_t lock = PTHREAD_MUTEX_INITIALIZER;
static int with_lock = 1;

/* Thread number `which`; its last status goes to the caller. */
static void *run(void *which) {
  const char *const setting = settings[*(int *)which % 6];
  const int n_deck = (int)strlen(deck), n_name = 4, n_settings = (int)strlen(setting);
  const double slice = 0.02, until = 1e300;
  const int none = 0;
  long long handle;
  double time;
  int status, finished = 0, reached;

  if (with_lock) pthread_mutex_lock(&lock);
  __dst_python_api_MOD_make("run", &n_deck, deck, &n_name, "deck", &n_settings, setting, &none, "", &none, NULL, &handle, &status,
                            strlen("run"), 1, 1, 1, 1);
  if (with_lock) pthread_mutex_unlock(&lock);
  while (status == 0 && !finished)
    __dst_python_api_MOD_proceed(&handle, &slice, &until, &finished, &reached, &time, &status);
  if (with_lock) pthread_mutex_lock(&lock);
  __dst_python_api_MOD_release(&handle);
  if (with_lock) pthread_mutex_unlock(&lock);
  *(int *)which = status;
  return NULL;
}

/* A sweep of 24 cases in pieces of 3; every other case fails at its limit of steps, the last pieces are given up. */
static long long sweep;
static int n_values, next_piece;
static int codes[pieces][piece];

static int open_sweep(void) {
  /* A grid of 12 angles and 2 limits. */
  static const double numbers[] = {0, 12, 2, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 50, 0};
  static const char keys[] = "system.misalignment_deg\nintegrator.max_steps";
  const int n_numbers = 17, n_deck = (int)strlen(deck), n_name = 4, n_settings = 0, n_keys = (int)strlen(keys);
  int status, n_points, ignored;

  __dst_python_api_MOD_make("sweep", &n_deck, deck, &n_name, "deck", &n_settings, "", &n_keys, keys, &n_numbers, numbers, &sweep, &status,
                            strlen("sweep"), 1, 1, 1, 1);
  if (status != 0) return 1;
  __dst_python_api_MOD_ask(&sweep, "points", &ignored, &n_points, &ignored, strlen("points"));
  if (n_points != 12 + 2) return 1;
  __dst_python_api_MOD_ask(&sweep, "quantities", &ignored, &ignored, &n_values, strlen("quantities"));
  return n_values > most_values;
}

static void *run_pieces(void *nothing) {
  double values[piece * most_values];
  char messages[message_length * piece];
  int number;

  while ((number = __atomic_fetch_add(&next_piece, 1, __ATOMIC_RELAXED)) < pieces) {
    const int first = number * piece + 1, n = piece, none = 0;
    int counts[piece];
    if (number == pieces - 2) __dst_python_api_MOD_sweep_stop(&sweep);
    __dst_python_api_MOD_sweep_run(&sweep, &first, &n, &n_values, &none, &none, values, NULL, counts, codes[number], messages, message_length);
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
    if (number[i] == (i % 6 == 5 ? too_many_steps : 0)) continue;
    printf("thread %d ended with %d\n", i, number[i]);
    wrong = 1;
  }
  if (check_sweep() != 0) {
    printf("the sweep has other cases than it should\n");
    wrong = 1;
  }
  __dst_python_api_MOD_release(&sweep);
  return wrong;
}
