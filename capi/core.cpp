#include <cstdlib>

#include "guard.h"
#include "pecs/version.h"

extern "C" {

const char* pecs_version(void) { return pecs::kVersion; }

void pecs_text_free(char* text) { std::free(text); }

}  // extern "C"
