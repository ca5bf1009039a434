/* SPDX-License-Identifier: Apache-2.0 */
/* Opens a store from C, takes a ball of its surface at an accuracy into arrays of its own, and
 * looks for the closest point. */
#include <stdio.h>
#include <stdlib.h>

#include "tools/c/mtdb.h"

static mtdb_error error;

/* Ends the program with the error's text. */
static void check(mtdb_code code) {
  if (code == MTDB_OK) return;
  fprintf(stderr, "%s\n", error.message);
  exit(1);
}

int main(int argc, char** argv) {
  mtdb_database* database = NULL;
  mtdb_object* object = NULL;
  mtdb_query* query = NULL;
  mtdb_cut* cut = NULL;
  mtdb_info info;
  mtdb_stats stats;
  mtdb_hit hit;
  mtdb_arrays arrays;
  char json[400];
  double size;
  int i;

  if (argc != 2) return 2;
  MTDB_INIT(info);
  MTDB_INIT(stats);
  MTDB_INIT(hit);
  MTDB_INIT(arrays);
  check(mtdb_open(argv[1], NULL, &database, &error));
  check(mtdb_open_object(database, NULL, NULL, &object, &error)); /* the store's only object */
  check(mtdb_get_object_info(object, &info, &error));
  size = info.bounds_max[0] - info.bounds_min[0];

  /* Whatever docs/query.md has. */
  snprintf(json, sizeof(json),
           "{\"region\": {\"sphere\": {\"centre\": [%.17g, %.17g, %.17g], \"radius\": %.17g}},"
           " \"threshold\": {\"relative\": 0.001}, \"max_triangles\": 100000}",
           info.bounds_max[0], info.bounds_max[1], info.bounds_max[2], size / 2);
  check(mtdb_create_query(object, json, &query, &error));
  check(mtdb_select(object, query, NULL, &cut, &error));
  check(mtdb_get_cut_stats(cut, &stats, &error));

  arrays.vertex_capacity = stats.vertices;
  arrays.triangle_capacity = stats.triangles;
  arrays.positions_float = malloc((size_t)stats.vertices * 3 * sizeof(float));
  arrays.indices = malloc((size_t)stats.triangles * 3 * sizeof(uint32_t));
  if (arrays.positions_float == NULL || arrays.indices == NULL) return 1;
  for (i = 0; i < 3; ++i) arrays.origin[i] = info.bounds_min[i];
  check(mtdb_copy_cut(cut, &arrays, &error));
  printf("%s: %lu of %lu triangles, error at most %g\n", mtdb_get_object_name(object),
         (unsigned long)stats.triangles, (unsigned long)info.triangles, stats.error_bound);

  check(mtdb_find_closest_point(object, info.bounds_max, size, NULL, &hit, &error));
  if (hit.found) printf("closest point %g %g %g\n", hit.point[0], hit.point[1], hit.point[2]);

  free(arrays.positions_float);
  free(arrays.indices);
  mtdb_free_cut(cut);
  mtdb_free_query(query);
  mtdb_free_object(object);
  mtdb_free_database(database);
  return 0;
}
