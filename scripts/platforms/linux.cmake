# What linux-x86_64.cmake and linux-aarch64.cmake share: clang and libc++ of Zig (dependencies.sh gets it from PyPI), and glibc
# 2.28, the oldest of the Linux wheel: RHEL 8, Debian 10, Ubuntu 20.04.
set(CMAKE_SYSTEM_NAME Linux)
include(${CMAKE_CURRENT_LIST_DIR}/static.cmake)
set(zig ${dependencies}/zig/ziglang/zig)
set(CMAKE_C_COMPILER ${zig} cc -target ${CMAKE_SYSTEM_PROCESSOR}-linux-gnu.2.28)
set(CMAKE_CXX_COMPILER ${zig} c++ -target ${CMAKE_SYSTEM_PROCESSOR}-linux-gnu.2.28)
foreach(language C CXX)
  set(CMAKE_${language}_FLAGS_INIT -fno-sanitize=undefined)
  set(CMAKE_${language}_ARCHIVE_CREATE "${zig} ar qc <TARGET> <OBJECTS>")
  set(CMAKE_${language}_ARCHIVE_APPEND "${zig} ar q <TARGET> <OBJECTS>")
  set(CMAKE_${language}_ARCHIVE_FINISH "${zig} ranlib <TARGET>")
endforeach()
foreach(kind EXE SHARED MODULE)
  set(CMAKE_${kind}_LINKER_FLAGS_INIT -s)  # this machine's strip knows one processor
endforeach()
set(CMAKE_STRIP true CACHE STRING "")
