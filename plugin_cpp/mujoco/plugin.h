// Shared parts of both plugins: life of an instance, and attributes that change at run time.
#ifndef MRDAMP_MUJOCO_PLUGIN_H_
#define MRDAMP_MUJOCO_PLUGIN_H_

#include <mujoco/mujoco.h>

#include <algorithm>
#include <cstdio>
#include <cstring>
#include <memory>
#include <string>
#include <vector>

namespace mrdamp {

template <class Instance>
Instance* Data(const mjData* d, int instance) {
  return reinterpret_cast<Instance*>(d->plugin_data[instance]);
}

// The present attribute bytes of an instance in the model.
inline const char* AttributeBytes(const mjModel* m, int instance, std::size_t* size) {
  const int begin = m->plugin_attradr[instance];
  const int end = instance + 1 < m->nplugin ? m->plugin_attradr[instance + 1] : static_cast<int>(m->npluginattr);
  *size = static_cast<std::size_t>(end - begin);
  return m->plugin_attr + begin;
}

// True if the bytes have changed since they were stored.
inline bool AttributesChanged(const mjModel* m, int instance, const std::vector<char>& kept) {
  std::size_t size;
  const char* now = AttributeBytes(m, instance, &size);
  return size != kept.size() || std::memcmp(now, kept.data(), size) != 0;
}

inline void KeepAttributes(const mjModel* m, int instance, std::vector<char>* kept) {
  std::size_t size;
  const char* now = AttributeBytes(m, instance, &size);
  kept->assign(now, now + size);
}

// Sets the callbacks of an instance's life. Instance::Make(m, instance, &error) returns a pointer or an error line,
// which is copied before anything can skip a destructor.
template <class Instance>
void SetLife(mjpPlugin* plugin) {
  plugin->init = [](const mjModel* m, mjData* d, int instance) {
    char line[400];
    {
      std::string error;
      if (std::unique_ptr<Instance> made = Instance::Make(m, instance, &error)) {
        d->plugin_data[instance] = reinterpret_cast<uintptr_t>(made.release());
        return 0;
      }
      std::snprintf(line, sizeof line, "%s", error.c_str());
    }
    mju_warning("%s", line);
    return -1;
  };
  plugin->destroy = [](mjData* d, int instance) {
    delete Data<Instance>(d, instance);
    d->plugin_data[instance] = 0;
  };
  plugin->reset = [](const mjModel* m, mjtNum* state, void*, int instance) {
    std::fill_n(state, m->plugin_statenum[instance], 0.0);
  };
  plugin->advance = [](const mjModel* m, mjData* d, int instance) { Data<Instance>(d, instance)->Advance(m, d); };
}

}  // namespace mrdamp

#endif  // MRDAMP_MUJOCO_PLUGIN_H_
