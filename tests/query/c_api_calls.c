/* SPDX-License-Identifier: Apache-2.0 */
/* c_api_calls STORE: calls every function of tools/c/mtdb.h from C, on a store of one object, and
 * prints the line of the first call that does not do what the header says. */
#include <math.h>
#include <pthread.h>
#include <sched.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "tests/query/c_api_checks.h"
#include "tools/c/mtdb.h"
#include "tools/c/mtdb_write.h"

static mtdb_database* database;
static mtdb_object* object;
static mtdb_info info;

static int take_nothing(void* user, const unsigned char* bytes, size_t size) {
  (void)user;
  (void)bytes;
  return size == 0 ? 0 : 1;
}

/* Looks at the object and its file. */
static void check_object(void) {
  mtdb_texts* names = NULL;
  mtdb_texts* failures = NULL;
  mtdb_object* other = NULL;
  mtdb_json* json = NULL;
  mtdb_object_options options;
  mtdb_attribute attribute;
  int level;
  MTDB_INIT(options);
  MTDB_INIT(attribute);
  CHECK(mtdb_get_abi_version() == MTDB_ABI_VERSION && strlen(mtdb_get_version()) > 0);
  OK(mtdb_list_objects(database, &names, &error));
  CHECK(mtdb_count_texts(names) == 1);
  CHECK(strcmp(mtdb_get_text(names, 0), mtdb_get_object_name(object)) == 0);
  mtdb_free_texts(names);
  OK(mtdb_get_object_info(object, &info, &error));
  CHECK(info.triangles > info.root_triangles && info.attributes > 0);
  OK(mtdb_get_object_attribute(object, 0, &attribute, &error));
  CHECK(attribute.offset == 0);
  OK(mtdb_get_object_json(object, &json, &error));
  CHECK(strstr(mtdb_get_json_text(json), "\"digest\":") != NULL);
  mtdb_free_json(json);
  CHECK(mtdb_get_json_text(NULL) == NULL);
  mtdb_free_json(NULL);
  /* The object has no texture; tests/python reads images. */
  FAILS(MTDB_NOT_FOUND, "page 0", mtdb_read_page(object, 0, take_nothing, NULL, &error));
  FAILS(MTDB_INVALID_ARGUMENT, "receive", mtdb_read_page(object, 0, NULL, NULL, &error));
  FAILS(MTDB_INVALID_ARGUMENT, "object", mtdb_read_page(NULL, 0, take_nothing, NULL, &error));
  for (level = MTDB_VERIFY_FAST; level <= MTDB_VERIFY_GLOBAL; ++level) {
    OK(mtdb_verify(object, (mtdb_verify_level)level, NULL, &failures, &error));
    CHECK(mtdb_count_texts(failures) == 0);
    mtdb_free_texts(failures);
  }
  FAILS(MTDB_INVALID_ARGUMENT, "level",
        mtdb_verify(object, (mtdb_verify_level)3, NULL, &failures, &error));
  FAILS(MTDB_INVALID_ARGUMENT, "failures",
        mtdb_verify(object, MTDB_VERIFY_FAST, NULL, NULL, &error));
  FAILS(MTDB_INVALID_ARGUMENT, "object",
        mtdb_verify(NULL, MTDB_VERIFY_FAST, NULL, &failures, &error));

  OK(mtdb_open_object(database, NULL, NULL, &other, &error));
  mtdb_free_object(other);
  options.cache_bytes = 1000; /* too little for any cluster */
  options.threads = 3;
  OK(mtdb_open_object(database, NULL, &options, &other, &error));
  {
    mtdb_cut* cut = NULL;
    mtdb_query* query = NULL;
    OK(mtdb_create_query(other, "{\"threshold\": 0}", &query, &error));
    FAILS(MTDB_BUDGET_EXCEEDED, "", mtdb_select(other, query, NULL, &cut, &error));
    mtdb_free_query(query);
  }
  mtdb_free_object(other);
  options.cache_bytes = 0;
  options.form = MTDB_FORM_IMPLICIT;
  OK(mtdb_open_object(database, NULL, &options, &other, &error));
  {
    mtdb_stats explicit_stats, implicit_stats;
    mtdb_cut* cut = NULL;
    MTDB_INIT(explicit_stats);
    MTDB_INIT(implicit_stats);
    OK(mtdb_select(object, NULL, NULL, &cut, &error));
    OK(mtdb_get_cut_stats(cut, &explicit_stats, &error));
    mtdb_free_cut(cut);
    OK(mtdb_select(other, NULL, NULL, &cut, &error));
    OK(mtdb_get_cut_stats(cut, &implicit_stats, &error));
    mtdb_free_cut(cut);
    CHECK(explicit_stats.triangles == implicit_stats.triangles);
  }
  mtdb_free_object(other);
  options.form = (mtdb_form)2;
  FAILS(MTDB_INVALID_ARGUMENT, "form", mtdb_open_object(database, NULL, &options, &other, &error));
  options.form = MTDB_FORM_EXPLICIT;
  options.threads = 100000;
  FAILS(MTDB_INVALID_ARGUMENT, "threads",
        mtdb_open_object(database, NULL, &options, &other, &error));
  options.threads = 0;
  options.struct_bytes = 0;
  FAILS(MTDB_INVALID_ARGUMENT, "struct_bytes",
        mtdb_open_object(database, NULL, &options, &other, &error));
  FAILS(MTDB_INVALID_ARGUMENT, "database", mtdb_open_object(NULL, NULL, NULL, &other, &error));
}

static mtdb_query* query_of(mtdb_object* of, const char* json) {
  mtdb_query* query = NULL;
  OK(mtdb_create_query(of, json, &query, &error));
  return query;
}

/* What a query gives. */
static mtdb_stats ask(const char* json) {
  mtdb_query* query = query_of(object, json);
  mtdb_cut* cut = NULL;
  mtdb_stats stats;
  MTDB_INIT(stats);
  OK(mtdb_select(object, query, NULL, &cut, &error));
  mtdb_free_query(query);
  OK(mtdb_get_cut_stats(cut, &stats, &error));
  CHECK(stats.clusters_total == info.clusters);
  CHECK(stats.active_triangles <= stats.triangles || info.triangles == 0);
  CHECK(stats.select_seconds >= 0 && stats.load_seconds >= 0 && stats.emit_seconds == 0);
  FAILS(MTDB_INVALID_ARGUMENT, "stats", mtdb_get_cut_stats(cut, NULL, &error));
  mtdb_free_cut(cut);
  FAILS(MTDB_INVALID_ARGUMENT, "cut", mtdb_get_cut_stats(NULL, &stats, &error));
  return stats;
}

/* Regions, thresholds and budgets. */
static void check_queries(void) {
  char json[512];
  mtdb_query* query = NULL;
  mtdb_stats all, some;
  const double size = info.bounds_max[0] - info.bounds_min[0];
  all = ask(NULL);
  CHECK(all.triangles == info.triangles && all.limit == MTDB_LIMIT_ACCURACY);
  CHECK(all.row_bytes == info.row_bytes && all.clusters_used == info.clusters);
  CHECK(ask("{}").triangles == all.triangles);

  sprintf(
      json,
      "{\"region\": {\"union\": [{\"box\": {\"min\": [%.17g, %.17g, %.17g], \"max\": [0, 0, 0]}},"
      " {\"sphere\": {\"centre\": [%.17g, %.17g, %.17g], \"radius\": %.17g}}]},"
      " \"threshold\": {\"smallest\": [%.17g,"
      " {\"linear\": {\"point\": [0, 0, 0], \"base\": 0, \"slope\": 0.02}}]}, \"clip\": true}",
      info.bounds_min[0], info.bounds_min[1], info.bounds_min[2], info.bounds_max[0],
      info.bounds_max[1], info.bounds_max[2], size / 3, size * 1e-2);
  some = ask(json);
  CHECK(some.triangles > 0 && some.triangles < all.triangles);
  CHECK(some.clusters_cached > 0 && some.nodes_visited > some.nodes_applied);
  CHECK(some.active_triangles > 0 && some.clusters_used <= some.clusters_total);
  /* What is wrong is said with its place. */
  FAILS(
      MTDB_INVALID_ARGUMENT, "region.sphere.radius: ",
      mtdb_create_query(object, "{\"region\": {\"sphere\": {\"centre\": [0,0,0], \"radius\": -1}}}",
                        &query, &error));
  FAILS(MTDB_INVALID_ARGUMENT, "byte", mtdb_create_query(object, "{\"region\": ", &query, &error));
  FAILS(MTDB_INVALID_ARGUMENT, "byte", mtdb_create_query(object, "", &query, &error));
  FAILS(MTDB_INVALID_ARGUMENT, "max_milliseconds",
        mtdb_create_query(object, "{\"max_milliseconds\": -1}", &query, &error));
  FAILS(MTDB_INVALID_ARGUMENT, "object", mtdb_create_query(NULL, "{}", &query, &error));
  FAILS(MTDB_INVALID_ARGUMENT, "query", mtdb_create_query(object, "{}", NULL, &error));
  CHECK(query == NULL);
  /* A fraction of the object's diagonal. */
  some = ask("{\"threshold\": {\"relative\": 0.01}}");
  CHECK(some.triangles < all.triangles && some.error_bound > 0);
  some = ask("{\"max_triangles\": 1000}");
  CHECK(some.triangles <= 1000 && some.limit == MTDB_LIMIT_TRIANGLES);
  some = ask("{\"max_milliseconds\": 1e-6}");
  CHECK(some.triangles < all.triangles && some.limit == MTDB_LIMIT_TIME);
  some = ask("{\"threshold\": \"coarsest\"}");
  CHECK(some.triangles < all.triangles && some.nodes_forced == 0);
}

/* A budget of bytes is for what is not in the cache: an object of its own. */
static void check_bytes(void) {
  mtdb_object* cold = NULL;
  mtdb_query* query = NULL;
  mtdb_cut* cut = NULL;
  mtdb_stats stats;
  MTDB_INIT(stats);
  OK(mtdb_open_object(database, NULL, NULL, &cold, &error));
  query = query_of(cold, "{\"max_bytes\": 1}");
  OK(mtdb_select(cold, query, NULL, &cut, &error));
  OK(mtdb_get_cut_stats(cut, &stats, &error));
  CHECK(stats.clusters_read == 0 && stats.triangles < info.triangles);
  CHECK(stats.limit == MTDB_LIMIT_BYTES);
  mtdb_free_cut(cut);
  mtdb_free_query(query);
  mtdb_free_object(cold);
}

/* What is in memory, again and again, of an object of its own: at the end all of it. */
static void check_available(void) {
  mtdb_object* cold = NULL;
  mtdb_query* query = NULL;
  mtdb_cut* cut = NULL;
  mtdb_stats stats;
  uint64_t triangles = 0;
  MTDB_INIT(stats);
  OK(mtdb_open_object(database, NULL, NULL, &cold, &error));
  query = query_of(cold, "{\"available_only\": true}");
  do {
    const mtdb_code code = mtdb_select(cold, query, NULL, &cut, &error);
    stats.limit = MTDB_LIMIT_MISSING;
    if (code == MTDB_NOT_YET) continue;
    CHECK(code == MTDB_OK);
    OK(mtdb_get_cut_stats(cut, &stats, &error));
    CHECK(stats.triangles >= triangles && stats.triangles <= info.triangles);
    triangles = stats.triangles;
    mtdb_free_cut(cut);
    cut = NULL;
  } while (stats.limit == MTDB_LIMIT_MISSING);
  CHECK(stats.limit == MTDB_LIMIT_ACCURACY && triangles == info.triangles);
  mtdb_free_query(query);
  mtdb_free_object(cold);
}

/* Arrays with normals at the end of their rows. */
static void check_arrays(void) {
  mtdb_query* query = NULL;
  mtdb_cut* cut = NULL;
  mtdb_stats stats;
  mtdb_arrays arrays;
  uint64_t i;
  MTDB_INIT(arrays);
  MTDB_INIT(stats);
  query = query_of(object, "{\"normals\": true}");
  OK(mtdb_select(object, query, NULL, &cut, &error));
  OK(mtdb_get_cut_stats(cut, &stats, &error));
  CHECK(stats.row_bytes == info.row_bytes + 3 * sizeof(float));
  arrays.vertex_capacity = stats.vertices;
  arrays.triangle_capacity = stats.triangles;
  arrays.positions = malloc((size_t)stats.vertices * 3 * sizeof(double));
  arrays.indices = malloc((size_t)stats.triangles * 3 * sizeof(uint32_t));
  arrays.rows = malloc((size_t)stats.vertices * stats.row_bytes);
  CHECK(arrays.positions != NULL && arrays.indices != NULL && arrays.rows != NULL);
  OK(mtdb_copy_cut(cut, &arrays, &error));
  for (i = 0; i < stats.vertices; ++i) {
    float n[3];
    memcpy(n, arrays.rows + i * stats.row_bytes + info.row_bytes, sizeof(n));
    CHECK(fabs(n[0] * n[0] + n[1] * n[1] + n[2] * n[2] - 1) < 1e-5);
  }
  for (i = 0; i < 3 * stats.triangles; ++i) CHECK(arrays.indices[i] < stats.vertices);
  free(arrays.positions);
  free(arrays.indices);
  free(arrays.rows);
  mtdb_free_query(query);
  mtdb_free_cut(cut);
}

static void* cancel(void* control) {
  mtdb_cancel(control);
  return NULL;
}

static int blocks;

/* Has another thread cancel the emission, once. */
static int cancel_elsewhere(void* control, const double* positions, const unsigned char* rows,
                            size_t count) {
  pthread_t thread;
  (void)positions;
  (void)rows;
  (void)count;
  ++blocks;
  CHECK(pthread_create(&thread, NULL, cancel, control) == 0);
  CHECK(pthread_join(thread, NULL) == 0);
  return 0;
}

static int count_triangles(void* user, const uint64_t* indices, size_t count) {
  (void)indices;
  *(uint64_t*)user += count;
  return 0;
}

struct selection {
  const mtdb_query* query;
  const mtdb_control* control;
  mtdb_code code;
};

/* Selects, with clusters read anew each time, until it is cancelled. */
static void* select_until_cancelled(void* argument) {
  struct selection* selection = argument;
  do {
    mtdb_object* cold = NULL;
    mtdb_cut* cut = NULL;
    selection->code = mtdb_open_object(database, NULL, NULL, &cold, NULL);
    if (selection->code == MTDB_OK) {
      selection->code = mtdb_select(cold, selection->query, selection->control, &cut, NULL);
    }
    mtdb_free_cut(cut);
    mtdb_free_object(cold);
  } while (selection->code == MTDB_OK);
  return NULL;
}

static void check_controls(void) {
  mtdb_control* control = NULL;
  mtdb_query* query = NULL;
  mtdb_cut* cut = NULL;
  mtdb_progress progress;
  mtdb_sink sink;
  mtdb_probe_options probing;
  mtdb_hit hit;
  struct selection selection;
  pthread_t thread;
  mtdb_texts* failures = NULL;
  uint64_t triangles = 0;
  long polls;
  int level;
  MTDB_INIT(progress);
  MTDB_INIT(sink);
  MTDB_INIT(probing);
  MTDB_INIT(hit);
  FAILS(MTDB_INVALID_ARGUMENT, "control", mtdb_create_control(NULL, &error));
  FAILS(MTDB_INVALID_ARGUMENT, "control", mtdb_get_progress(NULL, &progress, &error));
  mtdb_cancel(NULL);
  mtdb_free_control(NULL);

  /* A query whose control is watched, and not used. */
  OK(mtdb_create_control(&control, &error));
  FAILS(MTDB_INVALID_ARGUMENT, "progress", mtdb_get_progress(control, NULL, &error));
  query = query_of(object, "{}");
  OK(mtdb_get_progress(control, &progress, &error));
  CHECK(progress.nodes_applied == 0 && progress.triangles_emitted == 0 && !progress.cancelled);
  OK(mtdb_select(object, query, control, &cut, &error));
  sink.user = &triangles;
  sink.triangles = count_triangles;
  OK(mtdb_emit_cut(cut, &sink, &error));
  CHECK(triangles == info.triangles);
  OK(mtdb_get_progress(control, &progress, &error));
  CHECK(progress.triangles_emitted == info.triangles && !progress.cancelled);

  /* An emission that another thread stops between two blocks. */
  sink.user = control;
  sink.vertices = cancel_elsewhere;
  sink.triangles = NULL;
  FAILS(MTDB_CANCELLED, "", mtdb_emit_cut(cut, &sink, &error));
  CHECK(blocks >= 1);
  OK(mtdb_get_progress(control, &progress, &error));
  CHECK(progress.cancelled && progress.triangles_emitted == info.triangles);
  /* For ever after, of whatever takes the control. The cut keeps what it needs of it. */
  probing.control = control;
  FAILS(MTDB_CANCELLED, "",
        mtdb_find_closest_point(object, info.bounds_max, HUGE_VAL, &probing, &hit, &error));
  FAILS(MTDB_CANCELLED, "",
        mtdb_cast_ray(object, info.bounds_max, info.bounds_max, HUGE_VAL, &probing, &hit, &error));
  {
    mtdb_cut* none = NULL;
    FAILS(MTDB_CANCELLED, "", mtdb_select(object, query, control, &none, &error));
    CHECK(none == NULL);
  }
  mtdb_free_control(control);
  MTDB_INIT(sink);
  FAILS(MTDB_CANCELLED, "", mtdb_emit_cut(cut, &sink, &error));
  mtdb_free_cut(cut);
  OK(mtdb_select(object, query, NULL, &cut, &error));
  mtdb_free_cut(cut);
  mtdb_free_query(query);

  /* Selections that go on in another thread. */
  OK(mtdb_create_control(&control, &error));
  query = query_of(object, "{\"threshold\": {\"relative\": 1e-4}}");
  selection.query = query;
  selection.control = control;
  CHECK(pthread_create(&thread, NULL, select_until_cancelled, &selection) == 0);
  progress.nodes_applied = 0;
  for (polls = 0; progress.nodes_applied == 0 && polls < 10000000; ++polls) {
    OK(mtdb_get_progress(control, &progress, &error));
    sched_yield();
  }
  CHECK(progress.nodes_applied > 0 && progress.clusters_loaded > 0 && !progress.cancelled);
  mtdb_cancel(control);
  CHECK(pthread_join(thread, NULL) == 0);
  CHECK(selection.code == MTDB_CANCELLED);
  mtdb_free_control(control);
  mtdb_free_query(query);

  OK(mtdb_create_control(&control, &error));
  OK(mtdb_verify(object, MTDB_VERIFY_GLOBAL, control, &failures, &error));
  mtdb_free_texts(failures);
  mtdb_cancel(control);
  for (level = MTDB_VERIFY_FAST; level <= MTDB_VERIFY_GLOBAL; ++level) {
    FAILS(MTDB_CANCELLED, "cancelled",
          mtdb_verify(object, (mtdb_verify_level)level, control, &failures, &error));
  }
  mtdb_free_control(control);
}

static void check_probes(void) {
  const double down[3] = {0, 0, -1};
  mtdb_hit hit;
  mtdb_probe_options options;
  MTDB_INIT(hit);
  MTDB_INIT(options);
  OK(mtdb_find_closest_point(object, info.bounds_max, HUGE_VAL, NULL, &hit, &error));
  CHECK(hit.found && hit.distance >= 0 && hit.parameter == 0);
  OK(mtdb_cast_ray(object, info.bounds_max, down, HUGE_VAL, NULL, &hit, &error));
  options.error = 0.1;
  OK(mtdb_cast_ray(object, info.bounds_max, down, HUGE_VAL, &options, &hit, &error));
  options.error = -1;
  FAILS(MTDB_INVALID_ARGUMENT, "options.error",
        mtdb_cast_ray(object, info.bounds_max, down, HUGE_VAL, &options, &hit, &error));
  FAILS(MTDB_INVALID_ARGUMENT, "hit",
        mtdb_cast_ray(object, info.bounds_max, down, HUGE_VAL, NULL, NULL, &error));
}

static const mtdb_query* query_of_everything(void) {
  mtdb_query* query = NULL;
  OK(mtdb_create_query(object, "{}", &query, &error));
  return query;
}

static void check_comparisons(void) {
  const double up[16] = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 1, 0, 0, 0, 1};
  mtdb_json* json = NULL;
  mtdb_compare_options options;
  MTDB_INIT(options);
  OK(mtdb_compare(object, object, NULL, &json, &error));
  CHECK(strstr(mtdb_get_json_text(json), "\"identical\":true") != NULL);
  mtdb_free_json(json);
  options.transform = up;
  options.has_tolerance = 1;
  options.asks = MTDB_ASKS_B;
  OK(mtdb_compare(object, object, &options, &json, &error));
  CHECK(strstr(mtdb_get_json_text(json), "\"verdict\":\"exceeds\"") != NULL);
  CHECK(strstr(mtdb_get_json_text(json), "\"a_to_b\"") == NULL);
  mtdb_free_json(json);
  options.tolerance = 1.01;
  options.query = query_of_everything();
  OK(mtdb_compare(object, object, &options, &json, &error));
  CHECK(strstr(mtdb_get_json_text(json), "\"verdict\":\"within\"") != NULL);
  mtdb_free_json(json);
  mtdb_free_query((mtdb_query*)options.query);
  options.query = NULL;
  options.tolerance = -1;
  FAILS(MTDB_INVALID_ARGUMENT, "tolerance", mtdb_compare(object, object, &options, &json, &error));
  FAILS(MTDB_INVALID_ARGUMENT, "json", mtdb_compare(object, object, NULL, NULL, &error));
}

/* What is kept from others: stores from packed files, passwords from messages. */
static void check_guards(const char* store) {
  char shown[64];
  FAILS(MTDB_ALREADY_EXISTS, "a store", mtdb_pack(database, NULL, 0, store, NULL, NULL, &error));
  OK(mtdb_hide_secrets("a https://u:p@h/x?sig=1 b", shown, sizeof(shown), &error));
  CHECK(strcmp(shown, "a https://h/x b") == 0);
  OK(mtdb_hide_secrets("https://u:p@h/x", shown, 6, &error));
  CHECK(strcmp(shown, "https") == 0);
  FAILS(MTDB_INVALID_ARGUMENT, "size", mtdb_hide_secrets("a", shown, 0, &error));
  FAILS(MTDB_INVALID_ARGUMENT, "text", mtdb_hide_secrets(NULL, shown, 6, &error));
  FAILS(MTDB_INVALID_ARGUMENT, "shown", mtdb_hide_secrets("a", NULL, 6, &error));
}

int main(int argc, char** argv) {
  mtdb_open_options open_options;
  if (argc != 2) return 2;
  FAILS(MTDB_UNSUPPORTED, "ABI",
        mtdb_open_abi(MTDB_ABI_VERSION + 1, argv[1], NULL, &database, &error));
  MTDB_INIT(open_options);
  open_options.struct_bytes = 1;
  FAILS(MTDB_INVALID_ARGUMENT, "struct_bytes",
        mtdb_open(argv[1], &open_options, &database, &error));
  MTDB_INIT(open_options);
  OK(mtdb_open(argv[1], &open_options, &database, &error));
  mtdb_free_database(database);
  MTDB_INIT(info);
  OK(mtdb_open(argv[1], NULL, &database, &error));
  OK(mtdb_open_object(database, NULL, NULL, &object, &error));
  check_guards(argv[1]);
  check_object();
  check_queries();
  check_bytes();
  check_available();
  check_arrays();
  check_controls();
  check_probes();
  check_comparisons();
  mtdb_free_database(database);
  mtdb_free_object(object);
  printf("all is well\n");
  return 0;
}
