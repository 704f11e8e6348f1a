#include <cstdlib>

#include "guard.h"
#include "pecs/data_dir.h"
#include "pecs/version.h"

extern "C" {

const char* pecs_version(void) { return pecs::kVersion; }

void pecs_text_free(char* text) { std::free(text); }

char* pecs_data_dir(const char* room, pecs_error* error) {
  return pecs::capi::guard(error, static_cast<char*>(nullptr),
                           [&] { return pecs::capi::hand_over(pecs::data_dir(room).string()); });
}

}  // extern "C"
