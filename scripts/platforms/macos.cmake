# What macos-arm64.cmake and macos-x86_64.cmake share. For a Mac of that processor: built by CI, not tried by us.
set(CMAKE_OSX_DEPLOYMENT_TARGET 11.0 CACHE STRING "")
set(CMAKE_OSX_ARCHITECTURES ${CMAKE_SYSTEM_PROCESSOR} CACHE STRING "")
include(${CMAKE_CURRENT_LIST_DIR}/static.cmake)
