/* Loaded before the C library (LD_PRELOAD), it makes the n-th call of the system fail, or kills the program there: see faults.py.

   Counted are the calls that name a file of the folder FAULT_DIR, or a descriptor of one or of a pipe, and those about
   processes. FAULT is a list of KIND[+]:WHO:[NAME@]N with ';' between: at the N-th call (of NAME) of the first process
   (WHO = parent), of its children together (child), or of both (all), and with '+' at each one after it, KIND happens:

     kill                    SIGKILL to the process
     TERM, HUP, INT, USR1    this signal, then the call goes on
     hold                    the call waits until the file FAULT_GATE exists, with the fault's place in the list (0, 1 ...) after it
     short                   a write takes half of its bytes
     ENOSPC, EIO, ...        the call fails so, if a call of its kind can

   FAULT_LOG gets a line for each call: who, number of the process' and of all calls, name, kind of the call, file; and a line
   'hit ...' for each fault. With FAULT_CLOCK=S each look at the monotonic clock finds it S seconds later, and waiting takes
   no time: what depends on it depends on the number of looks only. FAULT_CLOSE=012 closes descriptors. With FAULT_SERVER=R,W the program stays where main begins, and a copy runs for each request
   from descriptor R; W gets its process id and, when it and all its children have ended, its wait status. That saves loading the
   libraries. */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <sched.h>
#include <signal.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/file.h>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <sys/uio.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

/* What a call does; a fault that no such call can have passes it by. A write (INSIDE) where the file has blocks, also
   reserved ones, needs no new room. */
enum { CREATE = 1, OPEN = 2, READ = 4, WRITE = 8, SYNC = 16, CLOSE = 32, SIZE = 64, LOCK = 128, REMOVE = 256, LOOK = 512,
       FORK = 1024, WAIT = 2048, FOR_WRITING = 4096, LINK = 8192, INSIDE = 16384 };
static const char letters[] = "cOrwsxtlu?fWoki";

static const struct { const char *name; int number, calls; } errors[] = {
  {"ENOSPC", ENOSPC, CREATE | WRITE | SYNC}, {"EDQUOT", EDQUOT, CREATE | WRITE | SYNC | CLOSE},
  {"EIO", EIO, CREATE | OPEN | READ | WRITE | INSIDE | SYNC | CLOSE | SIZE | REMOVE},
  {"EINTR", EINTR, OPEN | READ | WRITE | INSIDE | SYNC | CLOSE | SIZE | LOCK | WAIT},
  {"EROFS", EROFS, CREATE | FOR_WRITING | WRITE | INSIDE | SIZE | REMOVE}, {"EACCES", EACCES, CREATE | OPEN | REMOVE | LOOK},
  {"EBADF", EBADF, READ | WRITE | INSIDE | SYNC | CLOSE | SIZE | LOCK}, {"ENOLCK", ENOLCK, LOCK},
  {"EOPNOTSUPP", EOPNOTSUPP, LOCK}, {"EPERM", EPERM, LINK}, {"EMFILE", EMFILE, OPEN | FORK}};
static const struct { const char *name; int number; } signals[] = {
  {"TERM", SIGTERM}, {"HUP", SIGHUP}, {"INT", SIGINT}, {"USR1", SIGUSR1}};

enum { PARENT, CHILD, ALL, MOST_FAULTS = 8, MOST_PROCESSES = 256 };
static struct { char kind[16], name[24]; int persists, who, error, calls, signal; long n; } faults[MOST_FAULTS];
static int fault_count, log_file = -1, armed;
static pid_t first;
static char folder[4096];
static double clock_step;
static struct { long count[3], seen[MOST_FAULTS]; pid_t process[MOST_PROCESSES]; } *shared; /* by all processes of the run */

#define REAL(name) ({ static __typeof__(&name) real_; if (!real_) real_ = dlsym(RTLD_NEXT, #name); real_; })

static pid_t self(void) { return (pid_t)syscall(SYS_getpid); }

static void say(const char *format, ...) {
  char line[4400];
  va_list values;
  if (log_file < 0) return;
  va_start(values, format);
  int length = vsnprintf(line, sizeof line, format, values);
  va_end(values);
  if (length >= (int)sizeof line) length = sizeof line - 1;
  syscall(SYS_write, log_file, line, (size_t)length);
}

static void wait_for_gate(int number) {
  char gate[4200];
  struct timespec moment = {0, 500000};
  snprintf(gate, sizeof gate, "%s%d", getenv("FAULT_GATE"), number);
  while (syscall(SYS_faccessat, AT_FDCWD, gate, F_OK)) syscall(SYS_nanosleep, &moment, NULL);
}

enum { GO_ON = 0, FAIL = -1, HALF = 1 };

/* Count a call; what is to become of it. A call for large files has the name of the plain one. */
static int look(const char *call, int calls, const char *path) {
  if (!armed) return GO_ON;
  size_t length = strlen(call);
  char name[24];
  snprintf(name, sizeof name, "%.*s", (int)(length > 2 && !strcmp(call + length - 2, "64") ? length - 2 : length), call);
  int before = errno, result = GO_ON, who = self() != first;
  long own = __atomic_add_fetch(&shared->count[who], 1, __ATOMIC_SEQ_CST);
  long all = __atomic_add_fetch(&shared->count[ALL], 1, __ATOMIC_SEQ_CST);
  char kind[20] = "", *end = kind;
  for (int i = 0; letters[i]; i++) if (calls & 1 << i) *end++ = letters[i];
  *end = 0;
  say("%s %ld %ld %s %s %s\n", who ? "child" : "parent", own, all, name, *kind ? kind : "-", path);
  for (int i = 0; i < fault_count; i++) {
    if (faults[i].who != ALL && faults[i].who != who) continue;
    long n = faults[i].who == ALL ? all : own;
    if (*faults[i].name) {
      if (strcmp(faults[i].name, name)) continue;
      n = __atomic_add_fetch(&shared->seen[i], 1, __ATOMIC_SEQ_CST);
    }
    if (n < faults[i].n || (n > faults[i].n && !faults[i].persists)) continue;
    if (faults[i].calls && !(faults[i].calls & calls)) continue;
    const char *what = faults[i].kind;
    say("hit %s %ld %ld %s %s %s\n", who ? "child" : "parent", own, all, name, what, path);
    if (!strcmp(what, "kill")) kill(self(), SIGKILL);
    else if (!strcmp(what, "hold")) wait_for_gate(i);
    else if (!strcmp(what, "short")) result = HALF;
    else if (faults[i].signal) kill(self(), faults[i].signal);
    else if (faults[i].error) { before = faults[i].error; result = FAIL; }
  }
  errno = before;
  return result;
}

static int is_ours(const char *path) {
  return path && (path[0] != '/' || !strncmp(path, folder, strlen(folder)));
}

static const char *name_of(int file, char *path) {
  char link[32];
  snprintf(link, sizeof link, "/proc/self/fd/%d", file);
  long length = file == log_file ? -1 : syscall(SYS_readlinkat, AT_FDCWD, link, path, 4095L);
  if (length < 0) return NULL;
  path[length] = 0;
  return !strncmp(path, "pipe:", 5) || (path[0] == '/' && is_ours(path)) ? path : NULL;
}

static int look_at(const char *name, int calls, const char *path) { return is_ours(path) ? look(name, calls, path) : GO_ON; }

static int look_in(const char *name, int calls, int file) {
  char path[4096];
  int before = errno;
  const char *ours = armed ? name_of(file, path) : NULL;
  errno = before;
  return ours ? look(name, calls, path) : GO_ON;
}

static int kind_of_open(int flags) {
  return OPEN | (flags & O_CREAT ? CREATE : 0) | ((flags & O_ACCMODE) != O_RDONLY ? FOR_WRITING : 0) | (flags & O_TRUNC ? SIZE : 0);
}

#define MODE ({ va_list values_; va_start(values_, flags); mode_t mode_ = va_arg(values_, mode_t); va_end(values_); mode_; })
int open(const char *path, int flags, ...) {
  return look_at("open", kind_of_open(flags), path) ? -1 : REAL(open)(path, flags, MODE);
}
int open64(const char *path, int flags, ...) {
  return look_at("open", kind_of_open(flags), path) ? -1 : REAL(open64)(path, flags, MODE);
}
int openat(int at, const char *path, int flags, ...) {
  return look_at("openat", kind_of_open(flags), path) ? -1 : REAL(openat)(at, path, flags, MODE);
}
int openat64(int at, const char *path, int flags, ...) {
  return look_at("openat", kind_of_open(flags), path) ? -1 : REAL(openat64)(at, path, flags, MODE);
}

/* A call that names a file, and one that has a descriptor. */
#define BY_NAME(type, name, calls, path, fault, parameters, arguments) \
  type name parameters { return look_at(#name, calls, path) ? fault : REAL(name) arguments; }
#define BY_FILE(type, name, calls, fault, parameters, arguments) \
  type name parameters { return look_in(#name, calls, file) ? fault : REAL(name) arguments; }

BY_NAME(int, mkstemp, kind_of_open(O_CREAT | O_RDWR), path, -1, (char *path), (path))
BY_NAME(int, mkostemp, kind_of_open(O_CREAT | O_RDWR), path, -1, (char *path, int flags), (path, flags))
BY_NAME(int, mkdir, CREATE, path, -1, (const char *path, mode_t mode), (path, mode))
BY_NAME(int, rename, CREATE, to, -1, (const char *from, const char *to), (from, to))
BY_NAME(int, link, CREATE | LINK, to, -1, (const char *from, const char *to), (from, to))
BY_NAME(int, symlink, CREATE | LINK, to, -1, (const char *from, const char *to), (from, to))
BY_NAME(int, unlink, REMOVE, path, -1, (const char *path), (path))
BY_NAME(int, remove, REMOVE, path, -1, (const char *path), (path))
BY_NAME(int, chmod, FOR_WRITING, path, -1, (const char *path, mode_t mode), (path, mode))
BY_NAME(int, access, LOOK, path, -1, (const char *path, int mode), (path, mode))
BY_NAME(int, stat, LOOK, path, -1, (const char *path, struct stat *found), (path, found))
BY_NAME(int, lstat, LOOK, path, -1, (const char *path, struct stat *found), (path, found))
BY_NAME(int, stat64, LOOK, path, -1, (const char *path, struct stat64 *found), (path, found))
BY_NAME(int, lstat64, LOOK, path, -1, (const char *path, struct stat64 *found), (path, found))
int statx(int at, const char *path, int flags, unsigned mask, struct statx *found) {
  return (*path ? look_at("statx", LOOK, path) : look_in("statx", 0, at)) ? -1 : REAL(statx)(at, path, flags, mask, found);
}
BY_NAME(ssize_t, readlink, LOOK, path, -1, (const char *path, char *found, size_t size), (path, found, size))
BY_NAME(char *, realpath, LOOK, path, NULL, (const char *path, char *found), (path, found))

BY_FILE(ssize_t, read, READ, -1, (int file, void *bytes, size_t size), (file, bytes, size))
BY_FILE(ssize_t, pread, READ, -1, (int file, void *bytes, size_t size, off_t place), (file, bytes, size, place))
BY_FILE(ssize_t, pread64, READ, -1, (int file, void *bytes, size_t size, off64_t place), (file, bytes, size, place))
BY_FILE(int, fsync, SYNC, -1, (int file), (file))
BY_FILE(int, ftruncate, SIZE, -1, (int file, off_t size), (file, size))
BY_FILE(int, ftruncate64, SIZE, -1, (int file, off64_t size), (file, size))
BY_FILE(int, flock, LOCK, -1, (int file, int operation), (file, operation))
BY_FILE(int, fstat, 0, -1, (int file, struct stat *found), (file, found))
BY_FILE(int, fstat64, 0, -1, (int file, struct stat64 *found), (file, found))
BY_FILE(int, fchmod, FOR_WRITING, -1, (int file, mode_t mode), (file, mode))
BY_FILE(off_t, lseek, 0, -1, (int file, off_t place, int from), (file, place, from))
BY_FILE(off64_t, lseek64, 0, -1, (int file, off64_t place, int from), (file, place, from))

static int kind_of_fcntl(int command) {
  return command == F_SETLK || command == F_SETLKW || command == F_OFD_SETLK || command == F_OFD_SETLKW ? LOCK : 0;
}
#define ARGUMENT ({ va_list values_; va_start(values_, command); void *value_ = va_arg(values_, void *); va_end(values_); value_; })
int fcntl(int file, int command, ...) {
  return look_in("fcntl", kind_of_fcntl(command), file) ? -1 : REAL(fcntl)(file, command, ARGUMENT);
}
int fcntl64(int file, int command, ...) {
  return look_in("fcntl", kind_of_fcntl(command), file) ? -1 : REAL(fcntl64)(file, command, ARGUMENT);
}

/* The descriptor is closed whatever the call says. */
int close(int file) {
  int fault = look_in("close", CLOSE, file), number = errno, result = REAL(close)(file);
  if (!fault) return result;
  errno = number;
  return -1;
}

static size_t part(int fault, size_t size) { return fault == HALF ? (size + 1) / 2 : size; }
ssize_t write(int file, const void *bytes, size_t size) {
  int fault = look_in("write", WRITE, file);
  return fault < 0 ? -1 : REAL(write)(file, bytes, part(fault, size));
}
static int kind_of_write(int file, size_t size, off_t place) {
  struct stat found;
  return !armed || syscall(SYS_fstat, file, &found) || place + (off_t)size > 512 * (off_t)found.st_blocks ? WRITE : INSIDE;
}
ssize_t pwrite(int file, const void *bytes, size_t size, off_t place) {
  int fault = look_in("pwrite", kind_of_write(file, size, place), file);
  return fault < 0 ? -1 : REAL(pwrite)(file, bytes, part(fault, size), place);
}
ssize_t pwrite64(int file, const void *bytes, size_t size, off64_t place) {
  int fault = look_in("pwrite", kind_of_write(file, size, place), file);
  return fault < 0 ? -1 : REAL(pwrite64)(file, bytes, part(fault, size), place);
}
ssize_t writev(int file, const struct iovec *pieces, int count) {
  int fault = look_in("writev", WRITE, file);
  return fault < 0 ? -1 : REAL(writev)(file, pieces, part(fault, count));
}

/* Processes. */
pid_t fork(void) {
  if (armed && look("fork", FORK, "-")) return -1;
  pid_t process = REAL(fork)();
  if (armed && process == 0)
    for (int i = 0; i < MOST_PROCESSES; i++) {
      pid_t nobody = 0;
      if (__atomic_compare_exchange_n(&shared->process[i], &nobody, self(), 0, __ATOMIC_SEQ_CST, __ATOMIC_SEQ_CST)) break;
    }
  return process;
}
pid_t waitpid(pid_t process, int *status, int options) {
  if (armed && look("waitpid", WAIT, "-")) return -1;
  pid_t ended = REAL(waitpid)(process, status, options);
  for (int i = 0; armed && ended > 0 && i < MOST_PROCESSES; i++) if (shared->process[i] == ended) shared->process[i] = 0;
  return ended;
}

/* The clock. */
static long looks, waited; /* microseconds */
int clock_gettime(clockid_t which, struct timespec *now) {
  int result = REAL(clock_gettime)(which, now);
  if (!armed || clock_step <= 0.0 || which != CLOCK_MONOTONIC) return result;
  long past = (long)(1e6 * clock_step * (double)__atomic_add_fetch(&looks, 1, __ATOMIC_SEQ_CST)) + waited;
  now->tv_sec = 1000 + past / 1000000;
  now->tv_nsec = 1000 * (past % 1000000);
  return 0;
}
int usleep(useconds_t time) {
  if (!armed || clock_step <= 0.0) return REAL(usleep)(time);
  waited += time;
  return sched_yield();
}
int nanosleep(const struct timespec *time, struct timespec *left) {
  if (!armed || clock_step <= 0.0) return REAL(nanosleep)(time, left);
  return usleep((useconds_t)(1000000 * time->tv_sec + time->tv_nsec / 1000));
}

static void arm(void) {
  const char *text = getenv("FAULT_DIR"), *log = getenv("FAULT_LOG"), *step = getenv("FAULT_CLOCK"), *list = getenv("FAULT");
  const char *closed = getenv("FAULT_CLOSE");
  if (!text) return;
  snprintf(folder, sizeof folder, "%s", text);
  first = self();
  shared = mmap(NULL, sizeof *shared, PROT_READ | PROT_WRITE, MAP_SHARED | MAP_ANONYMOUS, -1, 0);
  shared->process[0] = first;
  clock_step = step ? atof(step) : 0.0;
  for (; list && *list && fault_count < MOST_FAULTS; list = strchr(list, ';') ? strchr(list, ';') + 1 : NULL) {
    char kind[16], who[16], where[40];
    if (sscanf(list, "%15[^:]:%15[^:]:%39[^;]", kind, who, where) != 3) abort();
    int i = fault_count++;
    char *plus = strchr(kind, '+'), *at = strchr(where, '@');
    if (plus) *plus = 0;
    faults[i].persists = plus != NULL;
    strcpy(faults[i].kind, kind);
    faults[i].who = !strcmp(who, "parent") ? PARENT : !strcmp(who, "child") ? CHILD : ALL;
    if (at) snprintf(faults[i].name, sizeof faults[i].name, "%.*s", (int)(at - where), where);
    faults[i].n = atol(at ? at + 1 : where);
    for (size_t k = 0; k < sizeof errors / sizeof *errors; k++)
      if (!strcmp(kind, errors[k].name)) { faults[i].error = errors[k].number; faults[i].calls = errors[k].calls; }
    for (size_t k = 0; k < sizeof signals / sizeof *signals; k++) if (!strcmp(kind, signals[k].name)) faults[i].signal = signals[k].number;
    if (!strcmp(kind, "short")) faults[i].calls = WRITE | INSIDE;
  }
  if (log) {
    int file = (int)syscall(SYS_openat, AT_FDCWD, log, O_WRONLY | O_CREAT | O_APPEND | O_CLOEXEC, 0644);
    log_file = (int)syscall(SYS_fcntl, file, F_DUPFD_CLOEXEC, 900L);
    syscall(SYS_close, file);
  }
  for (; closed && *closed; closed++) syscall(SYS_close, *closed - '0');
  armed = 1;
}

/* A request: its length, then texts that end with NUL: folder, file for what is printed, number of settings, the settings
   NAME=VALUE, the arguments. The copy that shall run it returns, with its arguments. */
static int serve(int from, int to, int *count, char ***arguments) {
  prctl(PR_SET_PDEATHSIG, SIGKILL);
  prctl(PR_SET_CHILD_SUBREAPER, 1);
  for (;;) {
    int length, status, result = 0;
    if (read(from, &length, sizeof length) != sizeof length) _exit(0);
    char *request = malloc((size_t)length + 1);
    for (int n = 0; n < length;) {
      ssize_t got = read(from, request + n, (size_t)(length - n));
      if (got <= 0) _exit(0);
      n += (int)got;
    }
    pid_t process = fork();
    if (process == 0) {
      char *end = request + length, *text = request;
#define NEXT ({ char *this_ = text; text += strlen(text) + 1; this_; })
      REAL(close)(from);
      REAL(close)(to);
      setsid();
      prctl(PR_SET_CHILD_SUBREAPER, 0);
      if (chdir(NEXT)) _exit(99);
      int file = REAL(open)(NEXT, O_WRONLY | O_CREAT | O_TRUNC | O_APPEND, 0644);
      dup2(file, 1);
      dup2(file, 2);
      if (file > 2) REAL(close)(file);
      for (int n = atoi(NEXT); n > 0; n--) putenv(NEXT);
      *arguments = calloc((size_t)length, sizeof(char *));
      for (*count = 0; text < end; ++*count) (*arguments)[*count] = NEXT;
      return 1;
    }
    free(request);
    if (write(to, &process, sizeof process) < 0) _exit(0);
    for (pid_t ended; (ended = REAL(waitpid)(-1, &status, 0)) > 0 || errno == EINTR;) if (ended == process) result = status;
    if (write(to, &result, sizeof result) < 0) _exit(0);
  }
}

int __libc_start_main(int (*)(int, char **, char **), int, char **, void (*)(void), void (*)(void), void (*)(void), void *);
int __libc_start_main(int (*program)(int, char **, char **), int count, char **arguments, void (*init)(void), void (*fini)(void),
                      void (*loader_fini)(void), void *stack) {
  int from, to;
  const char *server = getenv("FAULT_SERVER");
  if (server && sscanf(server, "%d,%d", &from, &to) == 2) {
    unsetenv("FAULT_SERVER");
    serve(from, to, &count, &arguments);
  }
  arm();
  return REAL(__libc_start_main)(program, count, arguments, init, fini, loader_fini, stack);
}
