#include "pecs/input/media.h"

#include <dlfcn.h>

#include "pecs/error.h"

#ifndef PECS_MEDIA_LIBRARY
extern "C" const pecs::input::Media pecs_media;
#endif

namespace pecs::input {

const Media& media() {
#ifdef PECS_MEDIA_LIBRARY
  static const Media& loaded = []() -> const Media& {
    void* library = ::dlopen(PECS_MEDIA_LIBRARY, RTLD_LAZY | RTLD_LOCAL);
    const void* found = library ? ::dlsym(library, "pecs_media") : nullptr;
    if (!found) throw Error(ExitCode::internal, ::dlerror());
    return *static_cast<const Media*>(found);
  }();
  return loaded;
#else
  return pecs_media;
#endif
}

}  // namespace pecs::input
