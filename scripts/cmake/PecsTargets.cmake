# One function per kind of target; every target gets the same warnings and sanitizers.

function(pecs_target_defaults target)
  target_compile_features(${target} PUBLIC cxx_std_20)
  target_compile_options(${target} PRIVATE -Wall -Wextra -Wpedantic -Wshadow -Wnon-virtual-dtor -Wconversion
    -Wno-sign-conversion $<$<BOOL:${PECS_WERROR}>:-Werror>
    # These two misfire inside std::string at -O3 (GCC 12, bug 105651).
    $<$<CXX_COMPILER_ID:GNU>:-Wno-restrict -Wno-maybe-uninitialized>
    # std::stable_sort and stable_partition of libstdc++ 12 use what it deprecates itself; GCC judges our own uses.
    $<$<CXX_COMPILER_ID:Clang>:-Wno-deprecated-declarations>)
  if(PECS_SANITIZE)
    target_compile_options(${target} PRIVATE -fsanitize=${PECS_SANITIZE} -fno-sanitize-recover=all -fno-omit-frame-pointer)
    target_link_options(${target} PUBLIC -fsanitize=${PECS_SANITIZE})
  endif()
endfunction()

# pecs_add_library(<name> SOURCES ... [PUBLIC libs...] [PRIVATE libs...]): a static library whose public headers
# lie in <dir>/include.
function(pecs_add_library name)
  cmake_parse_arguments(ARG "" "" "SOURCES;PUBLIC;PRIVATE" ${ARGN})
  add_library(${name} STATIC ${ARG_SOURCES})
  pecs_target_defaults(${name})
  target_include_directories(${name} PUBLIC ${CMAKE_CURRENT_SOURCE_DIR}/include PRIVATE ${CMAKE_CURRENT_SOURCE_DIR}/src)
  target_link_libraries(${name} PUBLIC ${ARG_PUBLIC} PRIVATE ${ARG_PRIVATE})
endfunction()

# pecs_vector_sources(<file>... [OPTIONS ...]): sources with Highway's kernels, and further compile options. Its lowest
# target on x86 is scalar code without vectors; every x86-64 since 2006 has SSSE3.
function(pecs_vector_sources)
  cmake_parse_arguments(ARG "" "" "OPTIONS" ${ARGN})
  if(CMAKE_SYSTEM_PROCESSOR MATCHES "x86_64|AMD64")
    list(APPEND ARG_OPTIONS -mssse3)
  endif()
  set_source_files_properties(${ARG_UNPARSED_ARGUMENTS} PROPERTIES COMPILE_OPTIONS "${ARG_OPTIONS}")
endfunction()

# pecs_add_program(<name> SOURCES ... LIBS ...)
function(pecs_add_program name)
  cmake_parse_arguments(ARG "" "" "SOURCES;LIBS" ${ARGN})
  add_executable(${name} ${ARG_SOURCES})
  pecs_target_defaults(${name})
  target_link_libraries(${name} PRIVATE ${ARG_LIBS})
endfunction()

# pecs_add_test(<name> SOURCES ... LIBS ...): a GoogleTest program. Tests find the checkout by PECS_SOURCE_DIR and
# the shared folder (absent on a user's machine: skip with a message) by tests/shared.h.
function(pecs_add_test name)
  cmake_parse_arguments(ARG "" "" "SOURCES;LIBS" ${ARGN})
  pecs_add_program(${name} SOURCES ${ARG_SOURCES} LIBS ${ARG_LIBS} GTest::gtest_main)
  target_include_directories(${name} PRIVATE ${PROJECT_SOURCE_DIR}/tests)
  target_compile_definitions(${name} PRIVATE PECS_SOURCE_DIR="${PROJECT_SOURCE_DIR}")
  gtest_discover_tests(${name} TEST_PREFIX ${name}. DISCOVERY_TIMEOUT 60)
endfunction()

# pecs_add_fuzzer(<name> SOURCES ... LIBS ... [DEFINE ...] [WORDS dictionary] [RUNS n]): a fuzzer, bin/fuzz_<name>; see
# tests/fuzz. With clang it is libFuzzer's, else driver.cpp's and a test of RUNS mutants.
function(pecs_add_fuzzer name)
  cmake_parse_arguments(ARG "" "WORDS;RUNS" "SOURCES;LIBS;DEFINE" ${ARGN})
  pecs_add_program(fuzz_${name} SOURCES ${ARG_SOURCES} LIBS ${ARG_LIBS})
  target_compile_definitions(fuzz_${name} PRIVATE ${ARG_DEFINE})
  add_dependencies(fuzzers fuzz_${name})
  set(words ${PROJECT_BINARY_DIR}/fuzz_words/${name}.dict)
  if(ARG_WORDS)
    configure_file(${CMAKE_CURRENT_SOURCE_DIR}/dict/${ARG_WORDS}.dict ${words} COPYONLY)
  endif()
  if(CMAKE_CXX_COMPILER_ID MATCHES Clang)
    target_link_options(fuzz_${name} PRIVATE -fsanitize=fuzzer)
    return()
  endif()
  target_link_libraries(fuzz_${name} PRIVATE fuzz_driver)
  add_test(NAME test_fuzz.${name} COMMAND fuzz_${name} ${ARG_RUNS} ${words} ${PROJECT_BINARY_DIR}/fuzz_seeds/${name}
    ${CMAKE_CURRENT_SOURCE_DIR}/corpus/${name})
  # Libraries that are not ours leak on damaged files; HDF5 keeps lists of what it freed.
  set_tests_properties(test_fuzz.${name} PROPERTIES FIXTURES_REQUIRED fuzz_seeds
    ENVIRONMENT "PECS_DATA=${PROJECT_SOURCE_DIR};ASAN_OPTIONS=detect_leaks=0:hard_rss_limit_mb=2048;UBSAN_OPTIONS=print_stacktrace=1")
endfunction()
