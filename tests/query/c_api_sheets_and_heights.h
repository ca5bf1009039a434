/* SPDX-License-Identifier: Apache-2.0
   Calls of C about sheets that are oriented, and about heights that changed; a part of
   c_api_more_calls.c. */
#ifndef MTDB_TESTS_QUERY_C_API_SHEETS_AND_HEIGHTS_H_
#define MTDB_TESTS_QUERY_C_API_SHEETS_AND_HEIGHTS_H_

#include <string.h>

#include "tests/query/c_api_checks.h"
#include "tools/c/mtdb.h"
#include "tools/c/mtdb_terrain.h"
#include "tools/c/mtdb_write.h"

/* Three triangles in a row, of which the middle one looks the other way. */
static void check_orient(mtdb_database* database) {
  static const double kPositions[] = {0, 0, 0, 1, 0, 0, 0, 1, 0, 1, 1, 0, 0, 2, 0};
  static const uint32_t kIndices[] = {0, 1, 2, 1, 2, 3, 2, 3, 4};
  mtdb_input input;
  mtdb_ingest_options options;
  mtdb_object* object = NULL;
  mtdb_json* json = NULL;
  MTDB_INIT(input);
  MTDB_INIT(options);
  input.vertices = 5;
  input.positions = kPositions;
  input.triangles = 3;
  input.indices = kIndices;
  options.orient = 1;
  OK(mtdb_ingest_arrays(database, "row", &input, &options, NULL, &error));
  OK(mtdb_open_object(database, "row", NULL, &object, &error));
  OK(mtdb_get_object_json(object, &json, &error));
  CHECK(strstr(mtdb_get_json_text(json), "\"turned_triangles\":1") != NULL);
  mtdb_free_json(json);
  mtdb_free_object(object);
  OK(mtdb_remove_object(database, "row", &error));
}

/* Of a terrain against itself. */
static void check_height_changes(mtdb_object* terrain) {
  const double window[4] = {3, 1, 2, 4};
  mtdb_height_change_options options;
  mtdb_json* json = NULL;
  MTDB_INIT(options);
  OK(mtdb_compare_heights(terrain, terrain, NULL, &json, &error));
  CHECK(strstr(mtdb_get_json_text(json), "\"identical\":true") != NULL);
  CHECK(strstr(mtdb_get_json_text(json), "\"fill_volume\":{\"low\":0") != NULL);
  mtdb_free_json(json);
  FAILS(MTDB_INVALID_ARGUMENT, "json",
        mtdb_compare_heights(terrain, terrain, &options, NULL, &error));
  options.has_width = 1;
  options.width = -1;
  FAILS(MTDB_INVALID_ARGUMENT, "width",
        mtdb_compare_heights(terrain, terrain, &options, &json, &error));
  options.width = 0;
  options.window = window;
  FAILS(MTDB_INVALID_ARGUMENT, "window",
        mtdb_compare_heights(terrain, terrain, &options, &json, &error));
}

#endif
