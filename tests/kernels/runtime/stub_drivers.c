/* Drivers of graphics cards without a card: as much of CUDA, NVML and Vulkan as kernels/drivers.py asks, and no more.
 *
 *   cc -shared -fPIC -o libcuda.so stub_drivers.c      also as libnvidia-ml.so.1 and libvulkan.so.1
 *
 * What they answer stands in environment variables STUB_*. Structures are written out as in vulkan_core.h, so that the
 * compiler, and not the code under test, knows where their members lie.
 */
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static long long number(const char *name, long long otherwise) { const char *s = getenv(name); return s ? atoll(s) : otherwise; }
static const char *text(const char *name, const char *otherwise) { const char *s = getenv(name); return s ? s : otherwise; }

/* CUDA */
int cuInit(unsigned flags) { (void)flags; return strcmp(text("CUDA_VISIBLE_DEVICES", "0"), "") ? (int)number("STUB_INIT", 0) : 100; }
int cuGetErrorString(int error, const char **words) { *words = error == 100 ? "no CUDA-capable device is detected" : "unknown error"; return 0; }
int cuDeviceGetCount(int *count) { *count = (int)number("STUB_COUNT", 1); return 0; }
int cuDriverGetVersion(int *version) { *version = (int)number("STUB_VERSION", 12040); return 0; }
int cuDeviceGet(int *device, int ordinal) { *device = 70 + ordinal; return 0; }
int cuDeviceGetName(char *name, int length, int device) { snprintf(name, length, "%s %d", text("STUB_NAME", "Stub card"), device - 70); return 0; }
int cuDeviceTotalMem_v2(size_t *bytes, int device) { *bytes = (size_t)number("STUB_TOTAL", 8LL << 30) + (device - 70); return 0; }
int cuDeviceGetPCIBusId(char *bus, int length, int device) { snprintf(bus, length, "0000:%02d:00.0", device); return 0; }
int cuDeviceGetAttribute(int *value, int attribute, int device) {
  int capability = (int)number("STUB_CC", 90);
  (void)device;
  *value = attribute == 75 ? capability / 10 : attribute == 76 ? capability % 10 : -1;
  return 0;
}

/* NVML: handles are made of the number in the bus. */
struct memory { unsigned long long total, free, used; };
int nvmlInit_v2(void) { return (int)number("STUB_NVML", 0); }
int nvmlShutdown(void) { return 0; }
int nvmlSystemGetDriverVersion(char *version, unsigned length) { snprintf(version, length, "550.54.15"); return 0; }
int nvmlDeviceGetHandleByPciBusId_v2(const char *bus, void **handle) { *handle = (void *)(uintptr_t)atoi(bus + 5); return 0; }
int nvmlDeviceGetMemoryInfo(void *handle, struct memory *memory) {
  memory->total = 8ULL << 30;
  memory->free = (unsigned long long)number("STUB_FREE", 6LL << 30) + ((uintptr_t)handle - 70);
  memory->used = memory->total - memory->free;
  return 0;
}

/* Vulkan: devices of the types in STUB_TYPES, such as "42": the first is software, the second a card. */
typedef struct head { int32_t type; struct head *next; } head;
typedef struct {
  uint32_t image1, image2, image3, cube, layers, texels, uniform_range, storage_range, push, allocations, samplers;
  uint64_t granularity, sparse;
  uint32_t sets, stage_samplers, stage_uniform, stage_storage, rest[90];
  size_t aligned[4];
} limits;
typedef struct {
  uint32_t api, driver, vendor, device, type;
  char name[256];
  uint8_t uuid[16];
  limits limits;
  uint32_t sparse[5];
} properties;
typedef struct { head head; properties properties; } properties2;
typedef struct { head head; int32_t id; char name[256], info[256]; uint8_t version[4]; } driver_properties;
typedef struct { head head; uint32_t before[39], float64, int64, int16, after[13]; } features2;
typedef struct { head head; uint32_t storage, uniform, push; } storage8;
typedef struct { head head; uint32_t float16, int8; } float16_int8;
typedef struct {
  head head;
  uint32_t types;
  struct { uint32_t flags, heap; } type[32];
  uint32_t heaps;
  struct { uint64_t size; uint32_t flags; } heap[16];
} memory2;
typedef struct { head head; uint64_t budget[16], usage[16]; } budget;

static void *chained(void *first, int32_t type) {
  for (head *one = first; one; one = one->next)
    if (one->type == type) return one;
  return NULL;
}
static const char *types(void) { return text("STUB_TYPES", "2"); }

int vkCreateInstance(const void *info, const void *allocator, void **instance) {
  (void)info; (void)allocator;
  *instance = (void *)1;
  return (int)number("STUB_INSTANCE", 0);
}
void vkDestroyInstance(void *instance, const void *allocator) { (void)instance; (void)allocator; }
int vkEnumeratePhysicalDevices(void *instance, uint32_t *count, void **devices) {
  (void)instance;
  for (uint32_t k = 0; devices && k < *count; k++) devices[k] = (void *)(uintptr_t)(k + 1);
  *count = (uint32_t)strlen(types());
  return 0;
}
void vkGetPhysicalDeviceProperties2(void *device, properties2 *out) {
  driver_properties *driver = chained(out, 1000196000);
  int k = (int)(uintptr_t)device - 1;
  out->properties.api = (1u << 22) | ((uint32_t)number("STUB_MINOR", 3) << 12) | 250;
  out->properties.type = (uint32_t)(types()[k] - '0');
  out->properties.limits.stage_storage = (uint32_t)number("STUB_BUFFERS", 1048576);
  snprintf(out->properties.name, 256, "%s %d", text("STUB_NAME", "Stub card"), k);
  if (driver) {
    snprintf(driver->name, 256, "%s", text("STUB_DRIVER", "stubv"));
    snprintf(driver->info, 256, "%s", text("STUB_INFO", "Mesa 24.1.2"));
  }
}
void vkGetPhysicalDeviceFeatures2(void *device, features2 *out) {
  storage8 *storage = chained(out, 1000177000);
  float16_int8 *numbers = chained(out, 1000082000);
  (void)device;
  out->float64 = (uint32_t)number("STUB_FLOAT64", 1);
  out->int64 = (uint32_t)number("STUB_INT64", 1);
  if (storage) storage->storage = (uint32_t)number("STUB_STORAGE8", 1);
  if (numbers) numbers->int8 = (uint32_t)number("STUB_INT8", 1);
}
void vkGetPhysicalDeviceMemoryProperties2(void *device, memory2 *out) {
  budget *left = chained(out, 1000237000);
  (void)device;
  out->heaps = 3; /* the processor's, the card's, and the window to the card that the processor sees */
  out->heap[0].size = 64ULL << 30;
  out->heap[1].size = 8ULL << 30;
  out->heap[1].flags = 1;
  out->heap[2].size = 256ULL << 20;
  out->heap[2].flags = 1;
  if (left && number("STUB_BUDGET", 1)) {
    left->budget[0] = 60ULL << 30;
    left->budget[1] = (uint64_t)number("STUB_FREE", 6LL << 30) + (1ULL << 30);
    left->usage[1] = 1ULL << 30;
    left->budget[2] = 200ULL << 20;
    left->usage[2] = 200ULL << 20;
  }
}
