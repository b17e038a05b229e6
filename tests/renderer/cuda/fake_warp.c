/* A warp for tests, whose lanes are threads: runs rayfarm_reserve, whose instructions for warps are warp_... here.
   All active lanes call it together, as they would on a card where they arrive together. */
#include <pthread.h>
#include <stdint.h>

enum { LANES = 32 };

int64_t rayfarm_reserve(int64_t *counters, int64_t which);

static pthread_barrier_t arrival;
static uint32_t active, shown[LANES];
static __thread uint32_t lane;

static void show(uint32_t value) {
  shown[lane] = value;
  pthread_barrier_wait(&arrival);
}

uint32_t warp_activemask(void) { return active; }

uint32_t warp_lanemask_lt(void) { return (1u << lane) - 1; }

uint32_t warp_match(uint32_t mask, uint32_t value) {
  uint32_t found = 0;
  show(value);
  for (uint32_t k = 0; k < LANES; k++)
    if (mask >> k & 1 && shown[k] == value) found |= 1u << k;
  pthread_barrier_wait(&arrival);
  return found;
}

uint32_t warp_shfl(uint32_t mask, uint32_t value, uint32_t from, uint32_t clamp) {
  show(value);
  value = shown[from & clamp];
  pthread_barrier_wait(&arrival);
  return value;
}

typedef struct {
  uint32_t lane;
  int64_t *counters, which, place;
} Call;

static void *call(void *given) {
  Call *own = given;
  lane = own->lane;
  own->place = rayfarm_reserve(own->counters, own->which);
  return 0;
}

/* Reserves an element of list which[k] for each lane k in the mask, at once; writes them to places. */
void reserve_in_warp(uint32_t mask, int64_t *counters, const int64_t *which, int64_t *places) {
  pthread_t threads[LANES];
  Call calls[LANES];
  active = mask;
  pthread_barrier_init(&arrival, 0, __builtin_popcount(mask));
  for (uint32_t k = 0; k < LANES; k++) {
    if (!(mask >> k & 1)) continue;
    calls[k] = (Call){k, counters, which[k], -1};
    pthread_create(&threads[k], 0, call, &calls[k]);
  }
  for (uint32_t k = 0; k < LANES; k++) {
    if (!(mask >> k & 1)) continue;
    pthread_join(threads[k], 0);
    places[k] = calls[k].place;
  }
  pthread_barrier_destroy(&arrival);
}
