// SPDX-License-Identifier: Apache-2.0
/* What the C tests of the C interface say, and how they end, when a call does not do what its
 * header says: the line, the condition and the last error. */
#ifndef MTDB_TESTS_QUERY_C_API_CHECKS_H_
#define MTDB_TESTS_QUERY_C_API_CHECKS_H_

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "tools/c/mtdb.h"

static mtdb_error error;

#define CHECK(condition)                                                                           \
  do {                                                                                             \
    if (!(condition)) {                                                                            \
      fprintf(stderr, "line %d: %s; the last message: %s\n", __LINE__, #condition, error.message); \
      exit(1);                                                                                     \
    }                                                                                              \
  } while (0)
#define OK(call) CHECK((call) == MTDB_OK)
/* An error whose text has `part`. */
#define FAILS(code, part, call) CHECK((call) == (code) && strstr(error.message, part) != NULL)

#endif
