/* SPDX-License-Identifier: Apache-2.0 */
/* consumer_c STORE: prints the triangles that the catalog and a query count, which must agree. */
#include <stdio.h>

#include "tools/c/mtdb.h"

int main(int argc, char** argv) {
  mtdb_error error = {{0}};
  mtdb_database* database = NULL;
  mtdb_object* object = NULL;
  mtdb_query* query = NULL;
  mtdb_cut* cut = NULL;
  mtdb_info info;
  mtdb_stats stats;
  if (argc != 2) return 2;
  MTDB_INIT(info);
  MTDB_INIT(stats);
  if (mtdb_open(argv[1], NULL, &database, &error) != MTDB_OK ||
      mtdb_open_object(database, NULL, NULL, &object, &error) != MTDB_OK ||
      mtdb_get_object_info(object, &info, &error) != MTDB_OK ||
      mtdb_create_query(object, "{\"threshold\": \"full\"}", &query, &error) != MTDB_OK ||
      mtdb_select(object, query, NULL, &cut, &error) != MTDB_OK ||
      mtdb_get_cut_stats(cut, &stats, &error) != MTDB_OK) {
    fprintf(stderr, "%s\n", error.message);
    return 1;
  }
  printf("%lu triangles\n", (unsigned long)stats.triangles);
  mtdb_free_query(query);
  mtdb_free_cut(cut);
  mtdb_free_object(object);
  mtdb_free_database(database);
  return stats.triangles == info.triangles ? 0 : 1;
}
