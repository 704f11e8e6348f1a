# One function per kind of target; every target gets the same warnings and sanitizers.

function(pecs_target_defaults target)
  target_compile_features(${target} PUBLIC cxx_std_20)
  # No fused multiply-add but where the code says MulAdd: compilers differ in what they fuse, and so would events.
  target_compile_options(${target} PRIVATE -ffp-contract=off -Wall -Wextra -Wpedantic -Wshadow -Wnon-virtual-dtor -Wconversion
    -Wno-sign-conversion $<$<BOOL:${PECS_WERROR}>:-Werror>
    # These two misfire inside std::string at -O3 (GCC 12, bug 105651).
    $<$<CXX_COMPILER_ID:GNU>:-Wno-restrict -Wno-maybe-uninitialized>
    # std::stable_sort and stable_partition of libstdc++ 12 use what it deprecates itself; GCC judges our own uses.
    $<$<CXX_COMPILER_ID:Clang>:-Wno-deprecated-declarations>)
  if(WIN32)
    target_compile_definitions(${target} PRIVATE _FILE_OFFSET_BITS=64)
    target_compile_options(${target} PRIVATE $<$<COMPILE_LANGUAGE:CXX>:-include${PROJECT_SOURCE_DIR}/scripts/cmake/utf8_paths.h>)
  endif()
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

# pecs_vector_sources(<file>...): sources with Highway's kernels. Its lowest target on x86 is scalar code without vectors;
# every x86-64 since 2006 has SSSE3.
function(pecs_vector_sources)
  if(CMAKE_SYSTEM_PROCESSOR MATCHES "x86_64|AMD64")
    set_source_files_properties(${ARGN} PROPERTIES COMPILE_OPTIONS -mssse3)
  endif()
endfunction()

# pecs_add_program(<name> SOURCES ... LIBS ...)
function(pecs_add_program name)
  cmake_parse_arguments(ARG "" "" "SOURCES;LIBS" ${ARGN})
  add_executable(${name} ${ARG_SOURCES})
  if(WIN32)
    target_sources(${name} PRIVATE ${PROJECT_SOURCE_DIR}/scripts/cmake/program.rc)
  endif()
  pecs_target_defaults(${name})
  target_link_libraries(${name} PRIVATE ${ARG_LIBS})
endfunction()

# pecs_quick_build(<name>): for fuzzers and tests, which cost more to compile than to run.
function(pecs_quick_build name)
  target_compile_options(${name} PRIVATE $<$<CONFIG:Release>:-O1>)
endfunction()

# pecs_add_test(<name> SOURCES ... LIBS ...): a GoogleTest program. Tests find the checkout by PECS_SOURCE_DIR and
# the shared folder (absent on a user's machine: skip with a message) by tests/shared.h.
function(pecs_add_test name)
  cmake_parse_arguments(ARG "" "" "SOURCES;LIBS" ${ARGN})
  pecs_add_program(${name} SOURCES ${ARG_SOURCES} LIBS ${ARG_LIBS} GTest::gtest_main)
  pecs_quick_build(${name})
  target_include_directories(${name} PRIVATE ${PROJECT_SOURCE_DIR}/tests)
  target_compile_definitions(${name} PRIVATE PECS_SOURCE_DIR="${PROJECT_SOURCE_DIR}")
  gtest_discover_tests(${name} TEST_PREFIX ${name}. DISCOVERY_TIMEOUT 60)
endfunction()

# pecs_add_fuzzer(<kind> SOURCE <file> LIBS ... [WORDS dictionary] [RUNS n]): a fuzzer, bin/fuzz_<kind>; see tests/fuzz.
# Kinds of one source share its object, fuzz_<file>, and its libraries. With clang it is libFuzzer's, else driver.cpp's
# and a test of RUNS mutants, a quarter of them without a sanitizer, which sees more faults in each.
function(pecs_add_fuzzer kind)
  cmake_parse_arguments(ARG "" "SOURCE;WORDS;RUNS" "LIBS" ${ARGN})
  get_filename_component(object fuzz_${ARG_SOURCE} NAME)
  if(NOT TARGET ${object})
    add_library(${object} OBJECT ${ARG_SOURCE})
    pecs_target_defaults(${object})
    pecs_quick_build(${object})
    target_link_libraries(${object} PUBLIC ${ARG_LIBS})
  endif()
  set(name fuzz_${kind})
  pecs_add_program(${name} SOURCES kind.cpp LIBS ${object})
  target_compile_definitions(${name} PRIVATE PECS_FUZZ_KIND="${kind}")
  add_dependencies(fuzzers ${name})
  set(words ${PROJECT_BINARY_DIR}/fuzz_words/${kind}.dict)
  if(ARG_WORDS)
    configure_file(${CMAKE_CURRENT_SOURCE_DIR}/dict/${ARG_WORDS}.dict ${words} COPYONLY)
  endif()
  if(CMAKE_CXX_COMPILER_ID MATCHES Clang)
    target_link_options(${name} PRIVATE -fsanitize=fuzzer)
    return()
  endif()
  target_link_libraries(${name} PRIVATE fuzz_driver)
  if(NOT PECS_SANITIZE)
    math(EXPR ARG_RUNS "${ARG_RUNS} / 4")
  endif()
  add_test(NAME test_fuzz.${kind} COMMAND ${name} ${ARG_RUNS} ${words} ${PROJECT_BINARY_DIR}/fuzz_seeds/${kind}
    ${CMAKE_CURRENT_SOURCE_DIR}/corpus/${kind})
  # Other libraries leak on damaged files; HDF5 keeps lists of what it freed.
  set_tests_properties(test_fuzz.${kind} PROPERTIES FIXTURES_REQUIRED fuzz_seeds
    ENVIRONMENT "PECS_DATA=${PROJECT_SOURCE_DIR};ASAN_OPTIONS=detect_leaks=0:hard_rss_limit_mb=2048;UBSAN_OPTIONS=print_stacktrace=1")
endfunction()
