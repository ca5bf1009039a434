# SPDX-License-Identifier: Apache-2.0
# The dynamic symbols of MTDB_LIBRARY, as MTDB_NM lists them, all begin with mtdb_, and there are the
# functions of the headers in tools/c: no fewer.
execute_process(COMMAND ${MTDB_NM} -D --defined-only ${MTDB_LIBRARY} OUTPUT_VARIABLE symbols
  COMMAND_ERROR_IS_FATAL ANY)
string(REGEX MATCHALL "[^\n ]+\n" names "${symbols}")
file(GLOB headers ${CMAKE_CURRENT_LIST_DIR}/../../tools/c/*.h)
set(header)
foreach(file ${headers})
  file(READ ${file} text)
  string(APPEND header "${text}")
endforeach()
string(REGEX MATCHALL "MTDB_API [^(;]*[ *](mtdb_[a-z_]+)\\(" declared "${header}")
list(LENGTH declared expected)
list(LENGTH names found)
foreach(name ${names})
  string(STRIP "${name}" name)
  if(NOT name MATCHES "^mtdb_")
    message(FATAL_ERROR "${name} is exported")
  endif()
endforeach()
if(expected LESS 40 OR NOT expected EQUAL found)
  message(FATAL_ERROR "tools/c/*.h declare ${expected} functions, the library has ${found}")
endif()
