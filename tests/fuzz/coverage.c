/* Which parts of the deck reader a case reaches: gcc's -fsanitize-coverage=trace-pc calls the first function
   in every basic block. Two blocks in a row are an edge; a map of hashed edges counts each case's visits. */
#include <stdint.h>
#include <string.h>

enum { places = 1 << 16 };

static unsigned char hits[places]; /* of this case, saturated */
static unsigned char seen[places]; /* of all cases: one bit for each class of counts */
static uintptr_t previous;

void __sanitizer_cov_trace_pc(void);
void coverage_begin(void);
int coverage_news(void);
int coverage_edges(void);

void __sanitizer_cov_trace_pc(void) {
  /* Relative to the program, so that a run can be repeated in spite of address randomisation. */
  const uintptr_t here = (uintptr_t)__builtin_return_address(0) - (uintptr_t)&coverage_begin;
  const uint32_t edge = (uint32_t)(here ^ (previous << 1)) * 2654435761u >> 16;
  if (hits[edge] < 255) ++hits[edge];
  previous = here;
}

/* A new case. */
void coverage_begin(void) {
  memset(hits, 0, sizeof hits);
  previous = 0;
}

/* Classes of counts, as in AFL: 1, 2, 3, 4-7, 8-15, 16-31, 32-127, more. */
static unsigned char count_class(unsigned char count) {
  if (count <= 3) return (unsigned char)(1u << (count - 1));
  if (count < 8) return 8;
  if (count < 16) return 16;
  if (count < 32) return 32;
  return count < 128 ? 64 : 128;
}

/* Number of edges that no case before has taken as often; they count as seen from now on. */
int coverage_news(void) {
  int news = 0;
  for (int i = 0; i < places; ++i) {
    if (hits[i] == 0) continue;
    const unsigned char class = count_class(hits[i]);
    news += (seen[i] & class) == 0;
    seen[i] |= class;
  }
  return news;
}

/* Number of edges that any case has taken. */
int coverage_edges(void) {
  int edges = 0;
  for (int i = 0; i < places; ++i) edges += seen[i] != 0;
  return edges;
}
