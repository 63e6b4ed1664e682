/* What is asked of the operating system where constants, structures or errno are its own; posix.f90 declares it to Fortran.

   A call that was interrupted is made again. -1 or NULL: it failed, and errno says why. POSIX and flock; what only one system has
   stands behind its #ifdef, with another way beside it. */
#ifdef __linux__
#define _GNU_SOURCE
#endif
#include <errno.h>
#include <fcntl.h>
#include <glob.h>
#include <limits.h>
#include <pthread.h>
#include <sched.h>
#include <signal.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/file.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <sys/statvfs.h>
#include <time.h>
#include <unistd.h>


const char *dst_reason(void) { return strerror(errno); }

/* Signals. */

static volatile sig_atomic_t received;

static void handle(int number, void (*handler)(int)) {
  struct sigaction action = {.sa_handler = handler, .sa_flags = SA_RESTART};
  sigemptyset(&action.sa_mask);
  sigaction(number, &action, NULL);
}

/* What is ignored stays so: the shell lets a job in the background ignore SIGINT. */
static void handle_unless_ignored(int number, void (*handler)(int)) {
  struct sigaction present;
  if (sigaction(number, NULL, &present) == 0 && present.sa_handler != SIG_IGN) handle(number, handler);
}

static void remember(int number) {
  received = number;
  if (number == SIGINT) handle(number, SIG_DFL);
}

/* From now on SIGUSR1 is remembered. It only asks to stop, and a scheduler may send it before there is a run. */
void dst_listen_to_requests(void) { handle_unless_ignored(SIGUSR1, remember); }

/* From now on SIGHUP (the terminal is gone), SIGINT and SIGTERM are remembered too. A second SIGINT ends the program at once. */
void dst_listen_to_signals(void) {
  handle_unless_ignored(SIGHUP, remember);
  handle_unless_ignored(SIGINT, remember);
  handle_unless_ignored(SIGTERM, remember);
}

/* The number of the signal that asked to stop, or 0; whether it asks to end now, not only to begin nothing new; its name. */
int dst_stop_signal(void) { return received; }
_Bool dst_is_told_to_end(void) { return received && received != SIGUSR1; }
const char *dst_signal_name(int number) {
  return number == SIGHUP ? "SIGHUP" : number == SIGINT ? "SIGINT" : number == SIGTERM ? "SIGTERM" : "SIGUSR1";
}

/* Let a write beyond the file-size limit fail instead of killing the process. */
void dst_ignore_size_limit_signal(void) { handle(SIGXFSZ, SIG_IGN); }

/* Time. */

void dst_wait(double seconds) {
  struct timespec time = {.tv_sec = (time_t)seconds, .tv_nsec = (long)(1e9 * (seconds - (double)(time_t)seconds))};
  nanosleep(&time, NULL);
}

/* Now, ISO 8601 in UTC. */
void dst_utc(char text[21]) {
  time_t now = time(NULL);
  struct tm parts;
  strftime(text, 21, "%Y-%m-%dT%H:%M:%SZ", gmtime_r(&now, &parts));
}

/* Files. */

/* What has a name (a link is not followed) or, without one, an open file; not there: exists is 0. */
typedef struct { _Bool exists, is_regular; int64_t bytes, inode, device; } identity;

void dst_look_up(int descriptor, const char *path, identity *file) {
  struct stat found;
  *file = (identity){0};
  if (*path ? lstat(path, &found) : fstat(descriptor, &found)) return;
  *file = (identity){1, S_ISREG(found.st_mode), found.st_size, (int64_t)found.st_ino, (int64_t)found.st_dev};
}

_Bool dst_is_same(const identity *a, const identity *b) {
  return a->exists && b->exists && a->inode == b->inode && a->device == b->device;
}

static _Bool has_name(int descriptor, const char *path) {
  identity here, there;
  dst_look_up(descriptor, "", &here);
  dst_look_up(-1, path, &there);
  return dst_is_same(&here, &there);
}

/* A call that was interrupted has closed the file all the same. */
int dst_close(int descriptor) { return close(descriptor) && errno != EINTR ? -1 : 0; }

/* A new descriptor, which programs started by this one do not get. */
static int new_descriptor(const char *path, int flags) {
  int descriptor;
  do descriptor = open(path, flags | O_CLOEXEC, 0666); while (descriptor < 0 && errno == EINTR);
  return descriptor;
}

static int close_with(int reason, int descriptor) {
  dst_close(descriptor);
  errno = reason;
  return -1;
}

/* Open the file with this name itself, never the target of a link (ELOOP), if it is a regular file (else EISDIR). O_NONBLOCK, since
   opening a pipe would wait for its other end. */
int dst_open_regular(const char *path, _Bool writes) {
  identity file;
  int descriptor = new_descriptor(path, (writes ? O_RDWR : O_RDONLY) | O_NONBLOCK | O_NOFOLLOW);
  if (descriptor < 0) return -1;
  dst_look_up(descriptor, "", &file);
  return file.is_regular ? descriptor : close_with(EISDIR, descriptor);
}

/* Open the file with this name, which is created if necessary, for reading and writing, and lock it until it is closed. EWOULDBLOCK:
   another process has locked it; ENOLCK: it was there, and this file system has no locks. */
int dst_open_locked(const char *path) {
  for (;;) {
    identity there;
    int descriptor = new_descriptor(path, O_RDWR | O_CREAT | O_EXCL), is_new = descriptor >= 0;
    if (!is_new && errno == EEXIST && (descriptor = dst_open_regular(path, 1)) < 0) {
      int reason = errno;
      dst_look_up(-1, path, &there);
      errno = reason;
      if (!there.exists) continue; /* the process that had it has removed it meanwhile */
    }
    if (descriptor < 0) return -1;
    if (flock(descriptor, LOCK_EX | LOCK_NB)) {
      if (errno == EWOULDBLOCK) return close_with(EWOULDBLOCK, descriptor);
      if (!is_new) return close_with(ENOLCK, descriptor);
    }
    if (has_name(descriptor, path)) return descriptor;
    dst_close(descriptor);
  }
}

/* Whether a process has locked this file for itself alone. */
_Bool dst_is_locked(const char *path) {
  int descriptor = dst_open_regular(path, 0);
  _Bool is_locked = descriptor >= 0 && flock(descriptor, LOCK_SH | LOCK_NB) && errno == EWOULDBLOCK;
  if (descriptor >= 0) dst_close(descriptor);
  return is_locked;
}

/* Give a new file its name, unless a file with that name was created meanwhile. */
int dst_place(const char *from, const char *to) {
  identity there;
  if (link(from, to) == 0) return unlink(from), 0;
  int reason = errno;
  dst_look_up(-1, to, &there);
  errno = reason;
  return there.exists ? -1 : rename(from, to); /* a file system without hard links */
}

/* Remove an open file, if it still has this name. */
void dst_remove_own(const char *path, int descriptor) {
  if (has_name(descriptor, path)) unlink(path);
}

/* All in one call of the system, more only if that writes a part: from a place on, or, if it is negative, where the file stands. */
int dst_write(int descriptor, const char *bytes, int64_t count, int64_t place) {
  dst_ignore_size_limit_signal();
  for (int64_t done = 0; done < count;) {
    size_t left = (size_t)(count - done);
    ssize_t written = place < 0 ? write(descriptor, bytes + done, left) : pwrite(descriptor, bytes + done, left, place + done);
    if (written >= 0) done += written;
    else if (errno == EAGAIN) dst_wait(0.001); /* a pipe or terminal that somebody has made non-blocking is full */
    else if (errno != EINTR) return -1;
  }
  return 0;
}

/* How many bytes could be read from a place on. */
int64_t dst_read(int descriptor, char *bytes, int64_t count, int64_t place) {
  int64_t done = 0;
  while (done < count) {
    ssize_t got = pread(descriptor, bytes + done, (size_t)(count - done), place + done);
    if (got == 0) break;
    if (got > 0) done += got;
    else if (errno != EINTR) return -1;
  }
  return done;
}

/* Cut a file off, or give back what was reserved behind its end. Failing here loses no data. */
void dst_set_file_size(int descriptor, int64_t length) {
  if (ftruncate(descriptor, length)) return;
}

/* Give an open file the permissions of the one with a name, as far as that is allowed. */
void dst_keep_mode(const char *path, int descriptor) {
  struct stat found;
  if (stat(path, &found) == 0 && fchmod(descriptor, found.st_mode & 07777)) return;
}

int dst_fsync(int descriptor) {
  while (fsync(descriptor)) if (errno != EINTR) return -1;
  return 0;
}

/* Make the entries of a folder survive a power failure, if the system can do that. */
void dst_sync_folder(const char *path) {
  int descriptor = new_descriptor(path, O_RDONLY);
  if (descriptor < 0) return;
  dst_fsync(descriptor);
  dst_close(descriptor);
}

/* Bytes that may still be written in a folder; negative if the file system does not tell. */
double dst_free_space(const char *folder) {
  struct statvfs room;
  return statvfs(folder, &room) || room.f_blocks == 0 ? -1.0 : (double)room.f_bavail * (double)room.f_frsize;
}

/* How many files have names that begin so; the names, in alphabetical order, are there until dst_forget_matches. */
int64_t dst_matches(const char *beginning, glob_t **found, char ***names) {
  char *pattern = malloc(2 * strlen(beginning) + 2), *end = pattern;
  *found = calloc(1, sizeof **found);
  if (!pattern || !*found) return 0;
  for (; *beginning; *end++ = *beginning++) if (strchr("\\*?[", *beginning)) *end++ = '\\';
  strcpy(end, "*");
  int failed = glob(pattern, 0, NULL, *found);
  free(pattern);
  *names = (*found)->gl_pathv;
  return failed ? 0 : (int64_t)(*found)->gl_pathc;
}

void dst_forget_matches(glob_t *found) {
  if (found) globfree(found);
  free(found);
}

/* Standard streams. */

/* Occupy those of the descriptors 0 to 2 that were closed when the program began (the lowest free one is given), so that no file
   gets one of them; the wrong way round, so that writing to a closed standard output still fails. */
void dst_occupy_descriptors(void) {
  for (int descriptor = STDIN_FILENO; descriptor <= STDERR_FILENO; descriptor++)
    if (fcntl(descriptor, F_GETFD) < 0 && open("/dev/null", descriptor == STDIN_FILENO ? O_WRONLY : O_RDONLY) < 0) return;
}

/* A reader that has gone does not end the program. */
void dst_put_error(const char *text, int64_t count) {
  struct sigaction before;
  int known = sigaction(SIGPIPE, NULL, &before) == 0;
  handle(SIGPIPE, SIG_IGN);
  dst_write(STDERR_FILENO, text, count, -1);
  if (known) sigaction(SIGPIPE, &before, NULL);
}

int dst_is_terminal(void) { return isatty(STDERR_FILENO); }

/* Processes. */

/* Become another program, which gets SIGINT when it unblocks it; the words of its command each end with NUL. Returns if that
 * fails. */
void dst_become(char *words, int count) {
  sigset_t interrupt, before;
  char **arguments = calloc((size_t)count + 1, sizeof *arguments);
  if (!arguments) return;
  for (int i = 0; i < count; words += strlen(words) + 1) arguments[i++] = words;
  sigemptyset(&interrupt);
  sigaddset(&interrupt, SIGINT);
  sigprocmask(SIG_BLOCK, &interrupt, &before);
  execvp(arguments[0], arguments);
  sigprocmask(SIG_SETMASK, &before, NULL);
  free(arguments);
}

/* Threads. OpenMP's have stacks of OMP_STACKSIZE or `ulimit -s`, where an overflow is a segmentation fault, and one too many for the
   system ends the program. These have stacks of a known size, and there are as many as the system allows. OpenMP's locks and atomic
   operations work between them too. */

/* Bytes of a stack: the default of Linux for a program, and the size that suffices; bytes that the work of a thread may need besides
   (an arena of malloc holds 64 MB, for two threads or more), and that of all. */
static const int64_t stack_bytes = 8 << 20, least_stack_bytes = 1 << 20, work_bytes = 32 << 20, common_bytes = 64 << 20;

typedef struct {
  void (*work)(void *, int);
  void *task;
  int number;
  pthread_t thread;
} member;

static void *do_part(void *argument) {
  member *self = argument;
  self->work(self->task, self->number);
  return NULL;
}

static _Bool begin(member *self) {
  pthread_attr_t attributes;
  if (pthread_attr_init(&attributes)) return 0;
  int failed = pthread_attr_setstacksize(&attributes, (size_t)stack_bytes) || pthread_create(&self->thread, &attributes, do_part, self);
  pthread_attr_destroy(&attributes);
  return !failed;
}

/* How many of so many threads have room for their stacks and their work: where memory is limited (`ulimit -v`, a job's share), what
   stacks took, the work would lack. Asked before the first begins: later the question would itself take room, if only for a moment.
   Memory that is not touched is not used. */
static int threads_with_room(int wanted) {
  while (wanted > 1) {
    void *volatile room = malloc((size_t)(common_bytes + (wanted - 1) * (stack_bytes + work_bytes)));
    free(room);
    if (room) break;
    wanted -= wanted < 16 ? 1 : wanted / 8;
  }
  return wanted;
}

/* Do a task with this thread, whose number is 1, and up to wanted - 1 others, as many as the system allows, and wait for all. */
void dst_run_in_threads(void (*work)(void *, int), void *task, int wanted) {
  int threads = threads_with_room(wanted), others = 0;
  member *members = threads > 1 ? calloc((size_t)threads, sizeof *members) : NULL;
  for (; members && others < threads - 1; others++) {
    members[others] = (member){.work = work, .task = task, .number = others + 2};
    if (!begin(&members[others])) break;
  }
  work(task, 1);
  while (others > 0) pthread_join(members[--others].thread, NULL);
  free(members);
}

/* Do a task where the stack is large enough: in this thread, or, if its stack is limited to less, in another one. 0: no other thread
   can be created, and the stack of this one is too small. */
_Bool dst_run_with_room(void (*work)(void *, int)) {
  struct rlimit limit;
  _Bool is_limited = getrlimit(RLIMIT_STACK, &limit) == 0 && limit.rlim_cur != RLIM_INFINITY;
  member other = {.work = work, .number = 1};
  if (is_limited && (int64_t)limit.rlim_cur < stack_bytes && begin(&other)) return !pthread_join(other.thread, NULL);
  if (is_limited && (int64_t)limit.rlim_cur < least_stack_bytes) return 0;
  work(NULL, 1);
  return 1;
}
