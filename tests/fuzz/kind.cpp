// Names what this fuzzer's source reads: kind() of fuzz.h.
extern "C" const char* pecs_fuzz_kind() { return PECS_FUZZ_KIND; }
