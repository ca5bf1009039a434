# The dynamic symbols of MTDB_LIBRARY, as MTDB_NM lists them, all begin with mtdb_, and there are the
# functions of query/mtdb.h: no fewer.
execute_process(COMMAND ${MTDB_NM} -D --defined-only ${MTDB_LIBRARY} OUTPUT_VARIABLE symbols
  COMMAND_ERROR_IS_FATAL ANY)
string(REGEX MATCHALL "[^\n ]+\n" names "${symbols}")
file(READ ${CMAKE_CURRENT_LIST_DIR}/../../query/mtdb.h header)
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
  message(FATAL_ERROR "query/mtdb.h declares ${expected} functions, the library has ${found}")
endif()
