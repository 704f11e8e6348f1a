#include <cstdlib>
#include <string_view>

#include "guard.h"
#include "pecs/data_dir.h"
#include "pecs/version.h"

#define PECS_TEXT_(x) #x
#define PECS_TEXT(x) PECS_TEXT_(x)
static_assert(std::string_view(PECS_VERSION) == pecs::kVersion, "pecs.h and VERSION differ");
static_assert(std::string_view(PECS_TEXT(PECS_VERSION_MAJOR) "." PECS_TEXT(PECS_VERSION_MINOR) "." PECS_TEXT(
                  PECS_VERSION_PATCH)) == PECS_VERSION);

extern "C" {

const char* pecs_version(void) { return pecs::kVersion; }

void pecs_text_free(char* text) { std::free(text); }

char* pecs_data_dir(const char* folder, pecs_error* error) {
  return pecs::capi::guard(
      error, [&] { return pecs::capi::hand_over(pecs::data_dir(&pecs::capi::given(folder, "folder")).string()); });
}

}  // extern "C"
