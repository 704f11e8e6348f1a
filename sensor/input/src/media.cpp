#include "pecs/input/media.h"

#include "pecs/platform.h"

#ifndef PECS_MEDIA_LIBRARY
extern "C" const pecs::input::Media pecs_media;
#endif

namespace pecs::input {

const Media& media() {
#ifdef PECS_MEDIA_LIBRARY
  static const void* const loaded = platform::symbol_of(PECS_MEDIA_LIBRARY, "pecs_media");
  return *static_cast<const Media*>(loaded);
#else
  return pecs_media;
#endif
}

}  // namespace pecs::input
