# SPDX-License-Identifier: Apache-2.0
# Installs mtdb into a folder of its own, builds tests/install/consumer against what is there and
# runs it on a store that the installed program made. Wants MTDB_BINARY_DIR, MTDB_GENERATOR, MTDB_CC,
# MTDB_CXX and MTDB_SANITIZE.
set(work ${MTDB_BINARY_DIR}/install-test)
file(REMOVE_RECURSE ${work})
file(MAKE_DIRECTORY ${work})

function(run)
  execute_process(COMMAND ${ARGN} RESULT_VARIABLE result OUTPUT_VARIABLE output
    ERROR_VARIABLE output)
  if(NOT result EQUAL 0)
    message(FATAL_ERROR "${ARGN}\n${output}")
  endif()
  set(output "${output}" PARENT_SCOPE)
endfunction()

function(expect text pattern)
  if(NOT text MATCHES "${pattern}")
    message(FATAL_ERROR "expected ${pattern}, found:\n${text}")
  endif()
endfunction()

run(${CMAKE_COMMAND} --install ${MTDB_BINARY_DIR} --prefix ${work}/prefix)
# The headers that cmake/installed_headers.txt lists, and no others; the consumer includes them all.
file(STRINGS ${CMAKE_CURRENT_LIST_DIR}/../../cmake/installed_headers.txt listed)
list(TRANSFORM listed REPLACE "^[a-z]+ " "")
list(SORT listed)
file(GLOB_RECURSE installed RELATIVE ${work}/prefix/include/mtdb ${work}/prefix/include/*)
list(SORT installed)
if(NOT installed STREQUAL listed)
  message(FATAL_ERROR "installed headers: ${installed}\nlisted: ${listed}")
endif()
list(TRANSFORM listed REPLACE "(.+)" "#include \"\\1\"")
list(JOIN listed "\n" includes)
file(WRITE ${work}/all_headers.cc "${includes}\n")
# Not by the compiler alone that mtdb is built with.
find_program(CLANGXX NAMES clang++ clang++-16 clang++-14)
if(CLANGXX)
  run(${CLANGXX} -std=c++20 -fsyntax-only -Wall -Wextra -Wshadow -Werror
    -I ${work}/prefix/include/mtdb ${work}/all_headers.cc)
else()
  message("no clang++: the installed headers are compiled by one compiler only")
endif()

set(flags)
if(MTDB_SANITIZE)
  set(flags -DCMAKE_C_FLAGS=-fsanitize=${MTDB_SANITIZE}
    -DCMAKE_CXX_FLAGS=-fsanitize=${MTDB_SANITIZE})
endif()
run(${CMAKE_COMMAND} -S ${CMAKE_CURRENT_LIST_DIR}/consumer -B ${work}/build -G ${MTDB_GENERATOR}
  -DCMAKE_PREFIX_PATH=${work}/prefix -DCMAKE_BUILD_TYPE= -DCMAKE_C_COMPILER=${MTDB_CC}
  -DCMAKE_CXX_COMPILER=${MTDB_CXX} -DALL_HEADERS=${work}/all_headers.cc ${flags})
run(${CMAKE_COMMAND} --build ${work}/build)

run(${work}/prefix/bin/mtdb generate sculpture ${work}/a.ply --triangles 5000)
run(${work}/prefix/bin/mtdb ingest ${work}/a.ply ${work}/a.mtdb --json)
string(JSON triangles GET "${output}" triangles)
foreach(program consumer consumer_c)
  run(${work}/build/${program} ${work}/a.mtdb)
  expect("${output}" "^${triangles} triangles\n$")
endforeach()
run(${work}/build/consumer_show ${work})
expect("${output}" "^http://127.0.0.1:[0-9]+ serves 12 x 9 samples, drawn in 60 x 40 pixels\n$")
# The example of C, without CMake.
find_program(PKG_CONFIG pkg-config)
if(PKG_CONFIG AND NOT MTDB_SANITIZE)
  run(${CMAKE_COMMAND} -E env PKG_CONFIG_PATH=${work}/prefix/lib/pkgconfig
    ${PKG_CONFIG} --cflags --libs mtdb)
  separate_arguments(options UNIX_COMMAND "${output}")
  run(${MTDB_CC} -std=c99 ${CMAKE_CURRENT_LIST_DIR}/../../tools/example_c.c -o ${work}/example_c
    ${options} -Wl,-rpath,${work}/prefix/lib)
  run(${work}/example_c ${work}/a.mtdb)
  expect("${output}" "triangles")
else()
  message("no pkg-config: its file is not tried")
endif()
# What a client says when nobody listens.
run(${work}/build/consumer_client http://127.0.0.1:1/objects/a)
expect("${output}" "^http://127.0.0.1:1: cannot connect: ")
file(REMOVE_RECURSE ${work})
