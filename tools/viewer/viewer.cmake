# SPDX-License-Identifier: Apache-2.0
# mtdb_viewer: the files of the page, compressed, as C++ (viewer_files.h). build.mjs makes them; it
# needs node and npm, npm's registry or its cache for the packages of package-lock.json, and clang
# with the libraries of wasm32. Without these the library has no files, and says why.
option(MTDB_VIEWER "Build the page of the viewer into mtdb" ON)
find_program(MTDB_NODE NAMES node nodejs)
find_program(MTDB_NPM NAMES npm)
find_program(MTDB_WASM_CXX NAMES clang++-16)
set(viewer_source ${CMAKE_CURRENT_LIST_DIR})
set(viewer_build ${PROJECT_BINARY_DIR}/viewer)
set(viewer_missing "")
if(NOT MTDB_VIEWER)
  set(viewer_missing "MTDB_VIEWER is off")
elseif(MTDB_SANITIZE OR MTDB_FUZZ)
  set(viewer_missing "builds for sanitizers and fuzzers have none")
elseif(NOT MTDB_NODE OR NOT MTDB_NPM)
  set(viewer_missing "node and npm were not there")
elseif(NOT MTDB_WASM_CXX OR NOT EXISTS /usr/lib/llvm-16/include/wasm32-wasi/c++/v1
    OR NOT EXISTS /usr/lib/wasm32-wasi/libc.a)
  set(viewer_missing "clang-16, lld-16, libc++-16-dev-wasm32, libc++abi-16-dev-wasm32, libclang-rt-16-dev-wasm32 or wasi-libc was not there")
endif()
set(viewer_files ${viewer_build}/viewer_files.cc)
if(viewer_missing)
  message(STATUS "The viewer is left out: ${viewer_missing}")
  set(MTDB_VIEWER_BUILT OFF CACHE INTERNAL "")
  set(viewer_files ${viewer_build}/no_viewer_files.cc)
  file(CONFIGURE OUTPUT ${viewer_files} @ONLY CONTENT [[
#include "tools/viewer/viewer_files.h"
std::span<const mtdb::ViewerFile> mtdb::ViewerFiles() { return {}; }
const char* mtdb::WhyNoViewerFiles() { return "@viewer_missing@"; }
]])
else()
  message(STATUS "The viewer is built by ${MTDB_NODE}")
  set(MTDB_VIEWER_BUILT ON CACHE INTERNAL "")
  file(GLOB viewer_sources CONFIGURE_DEPENDS ${viewer_source}/src/*.ts ${viewer_source}/static/*
    ${viewer_source}/wasm/*.cc ${viewer_source}/wasm/*.h)
  file(GLOB viewer_engine CONFIGURE_DEPENDS ${PROJECT_SOURCE_DIR}/tools/web/*.mjs
    ${PROJECT_SOURCE_DIR}/tools/web/*.txt ${PROJECT_SOURCE_DIR}/tools/web/src/*.ts
    ${PROJECT_SOURCE_DIR}/tools/web/wasm/*)
  set(viewer_client_sources "")
  foreach(list codecs/client_sources.txt query/engine_sources.txt tools/web/engine_sources.txt)
    file(STRINGS ${PROJECT_SOURCE_DIR}/${list} sources)
    list(APPEND viewer_client_sources ${sources})
  endforeach()
  list(REMOVE_DUPLICATES viewer_client_sources)
  list(TRANSFORM viewer_client_sources PREPEND ${PROJECT_SOURCE_DIR}/)
  set(viewer_headers "")
  foreach(folder codecs/stream codecs/coding codecs/cluster query store)
    file(GLOB_RECURSE headers CONFIGURE_DEPENDS ${PROJECT_SOURCE_DIR}/${folder}/*.h
      ${PROJECT_SOURCE_DIR}/${folder}/*.inc)
    list(APPEND viewer_headers ${headers})
  endforeach()
  add_custom_command(OUTPUT ${viewer_files}
    COMMAND ${MTDB_NODE} ${viewer_source}/build.mjs --build ${viewer_build}
      --npm ${MTDB_NPM} --wasm-cxx ${MTDB_WASM_CXX}
      "$<$<BOOL:${CMAKE_CXX_COMPILER_LAUNCHER}>:--launcher;${CMAKE_CXX_COMPILER_LAUNCHER}>"
    DEPENDS ${viewer_source}/build.mjs ${viewer_source}/steps.mjs ${viewer_source}/package.json
      ${viewer_source}/package-lock.json ${viewer_sources} ${viewer_client_sources}
      ${viewer_engine} ${viewer_headers}
    COMMENT "The viewer's page" VERBATIM COMMAND_EXPAND_LISTS)
endif()
add_library(mtdb_viewer STATIC ${viewer_files})
set_target_properties(mtdb_viewer PROPERTIES EXPORT_NAME viewer)
target_compile_features(mtdb_viewer PUBLIC cxx_std_20)
target_include_directories(mtdb_viewer PUBLIC $<BUILD_INTERFACE:${PROJECT_SOURCE_DIR}>)
