/* Which mutant is active (DYNSTICTION_MUTANT, 0 or unset: none), read before the program or the Python extension does anything;
   and which ones have been reached: their numbers are added to the file DYNSTICTION_MUTANTS_REACHED when it ends. */
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>

enum { most = 100000 };
static int active = 0;
static char reached[most];

__attribute__((constructor)) static void choose_mutant(void)
{
  const char *number = getenv("DYNSTICTION_MUTANT");
  if (number) active = atoi(number);
}

bool mutant_is(int number)
{
  if (number < most) reached[number] = 1;
  return number == active;
}

__attribute__((destructor)) static void note_reached(void)
{
  const char *name = getenv("DYNSTICTION_MUTANTS_REACHED");
  FILE *file = name ? fopen(name, "a") : NULL;
  if (!file) return;
  for (int i = 0; i < most; i++)
    if (reached[i]) fprintf(file, "%d\n", i);
  fclose(file);
}
