/* For test_checkpoint.py, loaded before the C library (LD_PRELOAD): the process is killed in place of its n-th write to a file,
   with KILL_AT=parent:n, or the child that makes the n-th write of all children, with KILL_AT=child:n. Without KILL_AT the
   writes are counted: "writes: parent N child N" on stderr at the end. */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <unistd.h>

static pid_t first;
static long *count; /* of the first process, of its children; shared by all */
static long limit[2];

__attribute__((constructor)) static void begin(void) {
  const char *wanted = getenv("KILL_AT");
  first = getpid();
  count = mmap(NULL, 2 * sizeof *count, PROT_READ | PROT_WRITE, MAP_SHARED | MAP_ANONYMOUS, -1, 0);
  if (wanted) limit[strncmp(wanted, "child", 5) == 0] = atol(strchr(wanted, ':') + 1);
}

__attribute__((destructor)) static void end(void) {
  if (getpid() == first && !limit[0] && !limit[1]) fprintf(stderr, "writes: parent %ld child %ld\n", count[0], count[1]);
}

static void look(void) {
  int child = getpid() != first;
  if (++count[child] == limit[child]) kill(getpid(), SIGKILL);
}

ssize_t pwrite(int file, const void *bytes, size_t size, off_t place) {
  static ssize_t (*real)(int, const void *, size_t, off_t);
  if (!real) real = dlsym(RTLD_NEXT, "pwrite");
  look();
  return real(file, bytes, size, place);
}

ssize_t pwrite64(int file, const void *bytes, size_t size, off64_t place) { return pwrite(file, bytes, size, place); }
