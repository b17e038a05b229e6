/* A driver for tests, with the part of CUDA's API that renderer/cuda/driver.py calls. The card's memory is this process's.
   A module is a shared object, named by $FAKE_CUDA_KERNEL, whose launch_NAME(job, threads) runs all threads of kernel NAME in order;
   in a folder of that name it is the file LENGTH.so, by the length of the module's PTX.
   $FAKE_CUDA_CARDS: a card each, NAME:MAJOR:MINOR:MEGABYTES, separated by commas. $FAKE_CUDA_VERSION: such as 12010.
   $FAKE_CUDA_UUID: a number that is added to the identity of each card.
   $FAKE_CUDA_FAULT: abort:NAME, fail:NAME, hang:NAME or skip:NAME, which the launch of kernel NAME does. */
#include <dlfcn.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

enum { OUT_OF_MEMORY = 2, NO_DEVICE = 100, INVALID_CONTEXT = 201, INVALID_PTX = 218, LAUNCH_FAILED = 719 };
typedef void (*Launch)(void *, int64_t);

static size_t used;
static void *faulty; /* the kernel of $FAKE_CUDA_FAULT */
static __thread void *current; /* context, of each thread */
#define NEEDS_CONTEXT if (!current) return INVALID_CONTEXT

static int card(int number, char *name, int *major, int *minor, long *megabytes) {
  const char *text = getenv("FAKE_CUDA_CARDS");
  for (int k = 0; text && *text; k++) {
    if (k == number && sscanf(text, "%63[^:]:%d:%d:%ld", name, major, minor, megabytes) == 4) return 1;
    text = strchr(text, ',');
    text = text ? text + 1 : NULL;
  }
  return 0;
}

int cuInit(unsigned flags) {
  char name[64];
  int major, minor;
  long megabytes;
  return card(0, name, &major, &minor, &megabytes) ? 0 : NO_DEVICE;
}
int cuDriverGetVersion(int *version) {
  const char *text = getenv("FAKE_CUDA_VERSION");
  *version = text ? atoi(text) : 13000;
  return 0;
}
int cuGetErrorName(int code, const char **text) {
  *text = code == OUT_OF_MEMORY ? "CUDA_ERROR_OUT_OF_MEMORY" : code == NO_DEVICE ? "CUDA_ERROR_NO_DEVICE" :
          code == LAUNCH_FAILED ? "CUDA_ERROR_LAUNCH_FAILED" : "CUDA_ERROR_INVALID_PTX";
  return 0;
}
int cuGetErrorString(int code, const char **text) {
  *text = code == OUT_OF_MEMORY ? "out of memory" : code == NO_DEVICE ? "no CUDA-capable device is detected" :
          code == LAUNCH_FAILED ? "unspecified launch failure" : "PTX is invalid";
  return 0;
}
int cuDeviceGetCount(int *count) {
  char name[64];
  int major, minor;
  long megabytes;
  for (*count = 0; card(*count, name, &major, &minor, &megabytes); (*count)++) {}
  return 0;
}
int cuDeviceGet(int *handle, int number) { return *handle = number, 0; }
int cuDeviceGetName(char *name, int size, int handle) {
  char found[64] = "";
  int major, minor;
  long megabytes;
  card(handle, found, &major, &minor, &megabytes);
  snprintf(name, size, "%s", found);
  return 0;
}
int cuDeviceGetAttribute(int *value, int which, int handle) {
  char name[64];
  int major = 0, minor = 0;
  long megabytes;
  card(handle, name, &major, &minor, &megabytes);
  *value = which == 75 ? major : which == 76 ? minor : 1;
  return 0;
}
int cuDeviceGetUuid(char *uuid, int handle) {
  const char *text = getenv("FAKE_CUDA_UUID");
  memset(uuid, handle + 1 + (text ? atoi(text) : 0), 16);
  return 0;
}
int cuDeviceTotalMem_v2(size_t *bytes, int handle) {
  char name[64];
  int major, minor;
  long megabytes = 0;
  card(handle, name, &major, &minor, &megabytes);
  *bytes = (size_t)megabytes << 20;
  return 0;
}
int cuDevicePrimaryCtxRetain(void **context, int handle) { return *context = (void *)(intptr_t)(handle + 1), 0; }
int cuDevicePrimaryCtxRelease_v2(int handle) { return 0; }
int cuCtxSetCurrent(void *context) { return current = context, 0; }
int cuCtxSynchronize(void) { NEEDS_CONTEXT; return 0; }
int cuMemAlloc_v2(uint64_t *address, size_t size) {
  NEEDS_CONTEXT;
  size_t all;
  cuDeviceTotalMem_v2(&all, 0);
  if (used + size > all) return OUT_OF_MEMORY;
  size_t *memory = malloc(size + 64);
  *memory = size;
  used += size;
  *address = (uint64_t)(uintptr_t)memory + 64;
  return 0;
}
int cuMemFree_v2(uint64_t address) {
  NEEDS_CONTEXT;
  size_t *memory = (size_t *)(uintptr_t)(address - 64);
  used -= *memory;
  free(memory);
  return 0;
}
int cuMemcpyHtoD_v2(uint64_t to, const void *from, size_t size) {
  NEEDS_CONTEXT;
  return memcpy((void *)(uintptr_t)to, from, size), 0;
}
int cuMemcpyDtoH_v2(void *to, uint64_t from, size_t size) {
  NEEDS_CONTEXT;
  return memcpy(to, (void *)(uintptr_t)from, size), 0;
}
int cuMemsetD8_v2(uint64_t to, unsigned char value, size_t size) {
  NEEDS_CONTEXT;
  return memset((void *)(uintptr_t)to, value, size), 0;
}
int cuModuleLoadDataEx(void **module, const char *ptx, unsigned count, int *options, void **values) {
  NEEDS_CONTEXT;
  if (!strstr(ptx, ".entry ")) {
    for (unsigned k = 0; k < count; k++)
      if (options[k] == 5) strcpy(values[k], "ptxas: there is no entry");
    return INVALID_PTX;
  }
  const char *path = getenv("FAKE_CUDA_KERNEL");
  char file[4096];
  struct stat about;
  if (path && !stat(path, &about) && S_ISDIR(about.st_mode)) {
    snprintf(file, sizeof file, "%s/%zu.so", path, strlen(ptx));
    path = file;
  }
  *module = dlopen(path, RTLD_NOW | RTLD_LOCAL);
  return *module ? 0 : INVALID_PTX;
}
int cuModuleUnload(void *module) { return 0; }
int cuModuleGetFunction(void **function, void *module, const char *name) {
  char launch[128];
  snprintf(launch, sizeof launch, "launch_%s", name);
  *function = dlsym(module, launch);
  const char *fault = getenv("FAKE_CUDA_FAULT"), *colon = fault ? strchr(fault, ':') : NULL;
  if (colon && !strcmp(colon + 1, name)) faulty = *function;
  return *function ? 0 : INVALID_PTX;
}
int cuLaunchKernel(void *function, unsigned gx, unsigned gy, unsigned gz, unsigned bx, unsigned by, unsigned bz, unsigned shared,
                   void *stream, void **arguments, void **extra) {
  NEEDS_CONTEXT;
  if (function == faulty) {
    const char *fault = getenv("FAKE_CUDA_FAULT");
    if (*fault == 'a') abort();
    if (*fault == 'f') return LAUNCH_FAILED;
    if (*fault == 's') return 0;
    for (;;) pause();
  }
  ((Launch)function)(arguments[0], *(int64_t *)arguments[1]);
  return 0;
}
