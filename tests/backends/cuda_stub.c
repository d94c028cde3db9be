/* A CUDA driver without a card, for tests: Taichi 1.7.4 starts on it and compiles kernels to PTX.
 *
 *   cc -shared -fPIC -o FOLDER/libcuda.so cuda_stub.c
 *   LD_LIBRARY_PATH=FOLDER CUDA_STUB_OUT=RESULTS python program.py
 *
 * Memory of the "card" is the host's, and copies are made. Kernels are not run: an array holds
 * after a launch what it held before. So what a program computes is wrong, and only how it uses the
 * driver can be seen:
 *
 *   RESULTS/0001.ptx, 0002.ptx, ...   the PTX of each module, in the order of loading
 *   RESULTS/calls.txt                 what was asked of the driver, a line a call:
 *       launch NAME BLOCKS THREADS    a kernel, how many blocks of how many threads
 *       alloc BYTES, free
 *       up BYTES                      a copy from host to card
 *       down BYTES                    from card to host
 *       within BYTES                  from card to card
 *       fill BYTES
 *       sync                          the host waits for the card
 *
 * CUDA_STUB_CC is the compute capability of the card, 90 without it. Taichi 1.7.4 writes PTX for
 * 8.6 at most, which is valid for all later cards; for 8.0 set CUDA_STUB_CC=80.
 *
 * Taichi looks functions up by name, and gets a pointer to each. Functions here leave out the last
 * arguments, or all, where they do not use them: that is the same call on x86-64 and ARM64.
 */
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { SUCCESS = 0, INVALID_VALUE = 1, OUT_OF_MEMORY = 2, NOT_SUPPORTED = 801 };

/* A handle that is no address: Taichi only hands it back. */
#define HANDLE ((void *)1)

static const char *folder(void) {
  const char *given = getenv("CUDA_STUB_OUT");
  return given ? given : ".";
}

/* The file of calls. It is written line by line, so that another program may read it meanwhile. */
static FILE *calls(void) {
  static FILE *file;
  if (!file) {
    char path[4096];
    snprintf(path, sizeof path, "%s/calls.txt", folder());
    file = fopen(path, "a");
    if (!file) file = stderr;
    setvbuf(file, NULL, _IOLBF, 0);
  }
  return file;
}

static void note(const char *what, size_t bytes) { fprintf(calls(), "%s %zu\n", what, bytes); }

/* The card. */

static int capability(void) {
  const char *given = getenv("CUDA_STUB_CC");
  return given ? atoi(given) : 90;
}

int cuDeviceGetAttribute(int *value, int attribute, int device) {
  (void)device;
  switch (attribute) {
    case 1: *value = 1024; break;              /* threads in a block, at most */
    case 10: *value = 32; break;               /* threads in a warp */
    case 16: *value = 132; break;              /* multiprocessors */
    case 39: *value = 2048; break;             /* threads on a multiprocessor, at most */
    case 75: *value = capability() / 10; break;
    case 76: *value = capability() % 10; break;
    case 97: *value = 101376; break;           /* bytes of shared memory that a block may have */
    case 106: *value = 32; break;              /* blocks on a multiprocessor, at most */
    default: *value = 1;                       /* it can */
  }
  return SUCCESS;
}

int cuDriverGetVersion(int *version) { *version = 12040; return SUCCESS; }
int cuDeviceGetCount(int *count) { *count = 1; return SUCCESS; }
int cuDeviceGet(int *device, int number) { *device = number; return SUCCESS; }
int cuDeviceGetName(char *name, int size, int device) {
  (void)device;
  snprintf(name, size, "stub");
  return SUCCESS;
}
int cuDeviceTotalMem_v2(size_t *bytes) {
  *bytes = (size_t)80 << 30;
  return SUCCESS;
}
int cuDeviceGetPCIBusId(char *id, int size) {
  snprintf(id, size, "0000:00:00.0");
  return SUCCESS;
}
int cuGetErrorName(int error, const char **name) {
  *name = error ? "CUDA_ERROR_OF_THE_STUB" : "CUDA_SUCCESS";
  return SUCCESS;
}
int cuGetErrorString(int error, const char **text) { return cuGetErrorName(error, text); }

/* What needs a handle, and what needs no more than to be done. */

#define GIVES_HANDLE(name) int name(void **handle) { *handle = HANDLE; return SUCCESS; }
GIVES_HANDLE(cuCtxCreate_v2)
GIVES_HANDLE(cuCtxGetCurrent)
GIVES_HANDLE(cuDeviceGetDefaultMemPool)
GIVES_HANDLE(cuDevicePrimaryCtxRetain)
GIVES_HANDLE(cuEventCreate)
GIVES_HANDLE(cuStreamCreate)

#define DONE(name) int name(void) { return SUCCESS; }
DONE(cuCtxSetCurrent)
DONE(cuCtxSetLimit)
DONE(cuEventDestroy)
DONE(cuEventRecord)
DONE(cuEventSynchronize)
DONE(cuFuncSetAttribute)
DONE(cuInit)
DONE(cuMemAdvise)
DONE(cuMemPoolSetAttribute)

#define UNSUPPORTED(name) int name(void) { return NOT_SUPPORTED; }
UNSUPPORTED(cuExternalMemoryGetMappedBuffer)
UNSUPPORTED(cuExternalMemoryGetMappedMipmappedArray)
UNSUPPORTED(cuImportExternalMemory)
UNSUPPORTED(cuImportExternalSemaphore)
UNSUPPORTED(cuMipmappedArrayGetLevel)
UNSUPPORTED(cuSignalExternalSemaphoresAsync)
UNSUPPORTED(cuSurfObjectCreate)
UNSUPPORTED(cuWaitExternalSemaphoresAsync)

/* Memory. */

int cuMemAlloc_v2(void **place, size_t bytes) {
  note("alloc", bytes);
  *place = calloc(1, bytes ? bytes : 1);
  return *place ? SUCCESS : OUT_OF_MEMORY;
}
int cuMemAllocAsync(void **place, size_t bytes) { return cuMemAlloc_v2(place, bytes); }
int cuMemAllocManaged(void **place, size_t bytes) { return cuMemAlloc_v2(place, bytes); }
int cuMemFree_v2(void *place) {
  fprintf(calls(), "free\n");
  free(place);
  return SUCCESS;
}
int cuMemFreeAsync(void *place) { return cuMemFree_v2(place); }

int cuMemsetD8_v2(void *place, unsigned char value, size_t bytes) {
  note("fill", bytes);
  memset(place, value, bytes);
  return SUCCESS;
}
int cuMemsetD32_v2(uint32_t *place, uint32_t value, size_t count) {
  note("fill", 4 * count);
  for (size_t k = 0; k < count; k++) place[k] = value;
  return SUCCESS;
}

static int copy(const char *way, void *to, const void *from, size_t bytes) {
  note(way, bytes);
  memmove(to, from, bytes);
  return SUCCESS;
}
int cuMemcpyHtoD_v2(void *to, const void *from, size_t n) { return copy("up", to, from, n); }
int cuMemcpyHtoDAsync_v2(void *to, const void *from, size_t n) { return copy("up", to, from, n); }
int cuMemcpyDtoH_v2(void *to, const void *from, size_t n) { return copy("down", to, from, n); }
int cuMemcpyDtoHAsync_v2(void *to, const void *from, size_t n) { return copy("down", to, from, n); }
int cuMemcpyDtoD_v2(void *to, const void *from, size_t n) { return copy("within", to, from, n); }

int cuMemGetInfo_v2(size_t *left, size_t *all) {
  *left = *all = (size_t)80 << 30;
  return SUCCESS;
}

/* Every pointer that Taichi asks about is one of the host's. */
int cuPointerGetAttribute(void) { return INVALID_VALUE; }

/* Kernels. */

int cuModuleLoadDataEx(void **module, const char *ptx) {
  static uintptr_t loaded;
  char path[4096];
  snprintf(path, sizeof path, "%s/%04d.ptx", folder(), (int)++loaded);
  FILE *file = fopen(path, "w");
  if (!file) return INVALID_VALUE;
  fputs(ptx, file);
  fclose(file);
  *module = (void *)loaded;
  return SUCCESS;
}
int cuModuleGetFunction(void **function, void *module, const char *name) {
  (void)module;
  *function = strdup(name); /* its name is its handle, for as long as the program runs */
  return *function ? SUCCESS : OUT_OF_MEMORY;
}
int cuLaunchKernel(const char *name, unsigned blocks, unsigned y, unsigned z, unsigned threads) {
  (void)y;
  (void)z;
  fprintf(calls(), "launch %s %u %u\n", name, blocks, threads);
  return SUCCESS;
}
int cuFuncGetAttribute(int *value) { *value = 1024; return SUCCESS; }
int cuOccupancyMaxActiveBlocksPerMultiprocessor(int *blocks) { *blocks = 8; return SUCCESS; }

/* The host waits. Nothing runs, so it has not to. */
int cuStreamSynchronize(void) {
  fprintf(calls(), "sync\n");
  return SUCCESS;
}
int cuEventElapsedTime(float *milliseconds) { *milliseconds = 0; return SUCCESS; }
