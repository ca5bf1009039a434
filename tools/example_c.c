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
  mtdb_arrays arrays = {0};
  double size;
  int i;

  if (argc != 2) return 2;
  check(mtdb_open(argv[1], &database, &error));
  check(mtdb_open_object(database, NULL, 0, &object, &error)); /* the store's only object */
  check(mtdb_object_info(object, &info, &error));
  size = info.bounds_max[0] - info.bounds_min[0];

  check(mtdb_create_query(&query, &error));
  /* Whatever docs/query.md has; common parts have functions of their own. */
  check(mtdb_query_set_json(
      query, object, "{\"threshold\": {\"relative\": 0.001}, \"max_triangles\": 100000}", &error));
  check(mtdb_query_add_sphere(query, info.bounds_max, size / 2, &error));
  check(mtdb_select(object, query, &cut, &error));
  check(mtdb_cut_stats(cut, &stats, &error));

  arrays.vertex_capacity = stats.vertices;
  arrays.triangle_capacity = stats.triangles;
  arrays.positions_float = malloc((size_t)stats.vertices * 3 * sizeof(float));
  arrays.indices = malloc((size_t)stats.triangles * 3 * sizeof(uint32_t));
  if (arrays.positions_float == NULL || arrays.indices == NULL) return 1;
  for (i = 0; i < 3; ++i) arrays.origin[i] = info.bounds_min[i];
  check(mtdb_cut_copy(cut, &arrays, &error));
  printf("%s: %lu of %lu triangles, error at most %g\n", mtdb_object_name(object),
         (unsigned long)stats.triangles, (unsigned long)info.triangles, stats.error_bound);

  check(mtdb_closest_point(object, info.bounds_max, -1, size, &hit, &error));
  if (hit.found) printf("closest point %g %g %g\n", hit.point[0], hit.point[1], hit.point[2]);

  free(arrays.positions_float);
  free(arrays.indices);
  mtdb_free_cut(cut);
  mtdb_free_query(query);
  mtdb_free_object(object);
  mtdb_free_database(database);
  return 0;
}
