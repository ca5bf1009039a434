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

/* Looks at the object and its file. */
static void check_object(void) {
  mtdb_names* names = NULL;
  mtdb_names* failures = NULL;
  mtdb_object* other = NULL;
  mtdb_object_options options = {0, 0, MTDB_FORM_EXPLICIT};
  mtdb_attribute attribute;
  int level;
  CHECK(mtdb_abi_version() == MTDB_ABI_VERSION && strlen(mtdb_version()) > 0);
  OK(mtdb_list_objects(database, &names, &error));
  CHECK(mtdb_names_count(names) == 1);
  CHECK(strcmp(mtdb_names_at(names, 0), mtdb_object_name(object)) == 0);
  mtdb_free_names(names);
  OK(mtdb_object_info(object, &info, &error));
  CHECK(info.triangles > info.root_triangles && info.attributes > 0);
  OK(mtdb_object_attribute(object, 0, &attribute, &error));
  CHECK(attribute.offset == 0);
  for (level = MTDB_VERIFY_FAST; level <= MTDB_VERIFY_GLOBAL; ++level) {
    OK(mtdb_verify(object, (mtdb_verify_level)level, NULL, &failures, &error));
    CHECK(mtdb_names_count(failures) == 0);
    mtdb_free_names(failures);
  }
  FAILS(MTDB_INVALID_ARGUMENT, "level",
        mtdb_verify(object, (mtdb_verify_level)3, NULL, &failures, &error));
  FAILS(MTDB_INVALID_ARGUMENT, "failures",
        mtdb_verify(object, MTDB_VERIFY_FAST, NULL, NULL, &error));
  FAILS(MTDB_INVALID_ARGUMENT, "object",
        mtdb_verify(NULL, MTDB_VERIFY_FAST, NULL, &failures, &error));

  OK(mtdb_open_object_with(database, NULL, NULL, &other, &error));
  mtdb_free_object(other);
  options.cache_bytes = 1000; /* too little for any cluster */
  options.threads = 3;
  OK(mtdb_open_object_with(database, NULL, &options, &other, &error));
  {
    mtdb_cut* cut = NULL;
    mtdb_query* query = NULL;
    OK(mtdb_create_query(&query, &error));
    OK(mtdb_query_set_json(query, other, "{\"threshold\": 0}", &error));
    FAILS(MTDB_BUDGET_EXCEEDED, "", mtdb_select(other, query, &cut, &error));
    mtdb_free_query(query);
  }
  mtdb_free_object(other);
  options.cache_bytes = 0;
  options.form = MTDB_FORM_IMPLICIT;
  OK(mtdb_open_object_with(database, NULL, &options, &other, &error));
  {
    mtdb_stats explicit_stats, implicit_stats;
    mtdb_cut* cut = NULL;
    mtdb_query* query = NULL;
    OK(mtdb_create_query(&query, &error));
    OK(mtdb_select(object, query, &cut, &error));
    OK(mtdb_cut_stats(cut, &explicit_stats, &error));
    mtdb_free_cut(cut);
    OK(mtdb_select(other, query, &cut, &error));
    OK(mtdb_cut_stats(cut, &implicit_stats, &error));
    mtdb_free_cut(cut);
    CHECK(explicit_stats.triangles == implicit_stats.triangles);
    mtdb_free_query(query);
  }
  mtdb_free_object(other);
  options.form = 2;
  FAILS(MTDB_INVALID_ARGUMENT, "form",
        mtdb_open_object_with(database, NULL, &options, &other, &error));
  options.form = MTDB_FORM_EXPLICIT;
  options.threads = 100000;
  FAILS(MTDB_INVALID_ARGUMENT, "threads",
        mtdb_open_object_with(database, NULL, &options, &other, &error));
  FAILS(MTDB_INVALID_ARGUMENT, "database", mtdb_open_object_with(NULL, NULL, NULL, &other, &error));
}

/* What a query gives. */
static mtdb_stats ask(const mtdb_query* query, mtdb_details* details) {
  mtdb_cut* cut = NULL;
  mtdb_stats stats;
  OK(mtdb_select(object, query, &cut, &error));
  OK(mtdb_cut_stats(cut, &stats, &error));
  OK(mtdb_cut_details(cut, details, &error));
  CHECK(details->clusters_total == info.clusters);
  CHECK(details->active_triangles <= stats.triangles || info.triangles == 0);
  CHECK(details->select_seconds >= 0 && details->load_seconds >= 0 && details->emit_seconds == 0);
  FAILS(MTDB_INVALID_ARGUMENT, "details", mtdb_cut_details(cut, NULL, &error));
  mtdb_free_cut(cut);
  FAILS(MTDB_INVALID_ARGUMENT, "cut", mtdb_cut_details(NULL, details, &error));
  return stats;
}

/* Regions, thresholds and budgets, by functions and as JSON. */
static void check_queries(void) {
  const double zero[3] = {0, 0, 0};
  char json[512];
  mtdb_query* query = NULL;
  mtdb_query* same = NULL;
  mtdb_details details;
  mtdb_stats all;
  mtdb_stats some;
  mtdb_stats likewise;
  const double size = info.bounds_max[0] - info.bounds_min[0];
  OK(mtdb_create_query(&query, &error));
  OK(mtdb_create_query(&same, &error));
  all = ask(query, &details);
  CHECK(all.triangles == info.triangles && details.limit == MTDB_LIMIT_THRESHOLD);
  CHECK(details.row_bytes == info.row_bytes && details.clusters_used == info.clusters);

  OK(mtdb_query_add_box(query, info.bounds_min, zero, &error));
  OK(mtdb_query_add_sphere(query, info.bounds_max, size / 3, &error));
  OK(mtdb_query_add_constant_error(query, size * 1e-2, &error));
  OK(mtdb_query_add_linear_error(query, zero, 0, 0.02, &error));
  OK(mtdb_query_set_clip(query, 1, &error));
  some = ask(query, &details);
  CHECK(some.triangles > 0 && some.triangles < all.triangles);
  sprintf(
      json,
      "{\"region\": {\"union\": [{\"box\": {\"min\": [%.17g, %.17g, %.17g], \"max\": [0, 0, 0]}},"
      " {\"sphere\": {\"centre\": [%.17g, %.17g, %.17g], \"radius\": %.17g}}]},"
      " \"threshold\": {\"smallest\": [%.17g,"
      " {\"linear\": {\"point\": [0, 0, 0], \"base\": 0, \"slope\": 0.02}}]}, \"clip\": true}",
      info.bounds_min[0], info.bounds_min[1], info.bounds_min[2], info.bounds_max[0],
      info.bounds_max[1], info.bounds_max[2], size / 3, size * 1e-2);
  OK(mtdb_query_set_max_triangles(same, 1, &error)); /* which the text replaces */
  OK(mtdb_query_set_json(same, object, json, &error));
  likewise = ask(same, &details);
  CHECK(likewise.triangles == some.triangles && likewise.nodes_applied == some.nodes_applied);
  CHECK(likewise.error_bound == some.error_bound);
  CHECK(details.clusters_cached > 0 && details.nodes_visited > some.nodes_applied);
  CHECK(details.active_triangles > 0 && details.clusters_used <= details.clusters_total);
  /* What is wrong is said with its place, and changes nothing. */
  FAILS(MTDB_INVALID_ARGUMENT, "region.sphere.radius: ",
        mtdb_query_set_json(same, object,
                            "{\"region\": {\"sphere\": {\"centre\": [0,0,0], \"radius\": -1}}}",
                            &error));
  FAILS(MTDB_INVALID_ARGUMENT, "byte", mtdb_query_set_json(same, object, "{\"region\": ", &error));
  FAILS(MTDB_INVALID_ARGUMENT, "byte", mtdb_query_set_json(same, object, "", &error));
  FAILS(MTDB_INVALID_ARGUMENT, "json", mtdb_query_set_json(same, object, NULL, &error));
  FAILS(MTDB_INVALID_ARGUMENT, "object", mtdb_query_set_json(same, NULL, "{}", &error));
  FAILS(MTDB_INVALID_ARGUMENT, "query", mtdb_query_set_json(NULL, object, "{}", &error));
  CHECK(ask(same, &details).triangles == some.triangles);
  /* A fraction of the object's diagonal; what is added later counts as well. */
  OK(mtdb_query_set_json(same, object, "{\"threshold\": {\"relative\": 0.01}}", &error));
  likewise = ask(same, &details);
  CHECK(likewise.triangles < all.triangles && likewise.error_bound > 0);
  OK(mtdb_query_add_full_resolution(same, &error));
  CHECK(ask(same, &details).triangles == all.triangles);

  OK(mtdb_query_set_json(same, object, "{\"max_triangles\": 1000}", &error));
  CHECK(ask(same, &details).triangles <= 1000 && details.limit == MTDB_LIMIT_TRIANGLES);
  OK(mtdb_query_set_max_triangles(same, 0, &error));
  CHECK(ask(same, &details).triangles == all.triangles);
  OK(mtdb_query_set_max_milliseconds(same, 1e-6, &error));
  CHECK(ask(same, &details).triangles < all.triangles && details.limit == MTDB_LIMIT_TIME);
  FAILS(MTDB_INVALID_ARGUMENT, "milliseconds", mtdb_query_set_max_milliseconds(same, -1, &error));
  FAILS(MTDB_INVALID_ARGUMENT, "milliseconds", mtdb_query_set_max_milliseconds(same, NAN, &error));
  FAILS(MTDB_INVALID_ARGUMENT, "query", mtdb_query_set_max_milliseconds(NULL, 1, &error));
  OK(mtdb_query_set_max_milliseconds(same, 0, &error));
  CHECK(ask(same, &details).triangles == all.triangles);
  FAILS(MTDB_INVALID_ARGUMENT, "query", mtdb_query_set_max_bytes(NULL, 1, &error));
  FAILS(MTDB_INVALID_ARGUMENT, "query", mtdb_query_set_normals(NULL, 1, &error));
  FAILS(MTDB_INVALID_ARGUMENT, "query", mtdb_query_set_available_only(NULL, 1, &error));

  mtdb_free_query(query);
  OK(mtdb_create_query(&query, &error));
  OK(mtdb_query_add_coarsest(query, &error));
  CHECK(ask(query, &details).triangles < all.triangles && details.nodes_forced == 0);
  mtdb_free_query(query);
  mtdb_free_query(same);
}

/* A budget of bytes is for what is not in the cache: an object of its own. */
static void check_bytes(void) {
  mtdb_object* cold = NULL;
  mtdb_query* query = NULL;
  mtdb_cut* cut = NULL;
  mtdb_stats stats;
  mtdb_details details;
  OK(mtdb_open_object(database, NULL, 0, &cold, &error));
  OK(mtdb_create_query(&query, &error));
  OK(mtdb_query_set_max_bytes(query, 1, &error));
  OK(mtdb_select(cold, query, &cut, &error));
  OK(mtdb_cut_stats(cut, &stats, &error));
  OK(mtdb_cut_details(cut, &details, &error));
  CHECK(stats.clusters_read == 0 && stats.triangles < info.triangles);
  CHECK(details.limit == MTDB_LIMIT_BYTES);
  mtdb_free_cut(cut);
  mtdb_free_query(query);
  mtdb_free_object(cold);
}

/* What is in memory, again and again, of an object of its own: at the end all of it. */
static void check_available(const char* json) {
  mtdb_object* cold = NULL;
  mtdb_query* query = NULL;
  mtdb_cut* cut = NULL;
  mtdb_stats stats;
  mtdb_details details;
  uint64_t triangles = 0;
  OK(mtdb_open_object(database, NULL, 0, &cold, &error));
  OK(mtdb_create_query(&query, &error));
  if (json != NULL) {
    OK(mtdb_query_set_json(query, cold, json, &error));
  } else {
    OK(mtdb_query_set_available_only(query, 1, &error));
  }
  do {
    const mtdb_code code = mtdb_select(cold, query, &cut, &error);
    details.limit = MTDB_LIMIT_MISSING;
    if (code == MTDB_NOT_YET) continue;
    CHECK(code == MTDB_OK);
    OK(mtdb_cut_stats(cut, &stats, &error));
    OK(mtdb_cut_details(cut, &details, &error));
    CHECK(stats.triangles >= triangles && stats.triangles <= info.triangles);
    triangles = stats.triangles;
    mtdb_free_cut(cut);
    cut = NULL;
  } while (details.limit == MTDB_LIMIT_MISSING);
  CHECK(details.limit == MTDB_LIMIT_THRESHOLD && triangles == info.triangles);
  OK(mtdb_query_set_max_bytes(query, 1000, &error));
  FAILS(MTDB_INVALID_ARGUMENT, "limit of bytes", mtdb_select(cold, query, &cut, &error));
  OK(mtdb_query_set_available_only(query, 0, &error));
  OK(mtdb_select(cold, query, &cut, &error));
  mtdb_free_cut(cut);
  mtdb_free_query(query);
  mtdb_free_object(cold);
}

/* Arrays with normals at the end of their rows. */
static void check_arrays(void) {
  mtdb_query* query = NULL;
  mtdb_cut* cut = NULL;
  mtdb_stats stats;
  mtdb_details details;
  mtdb_arrays arrays;
  uint64_t i;
  memset(&arrays, 0, sizeof(arrays));
  OK(mtdb_create_query(&query, &error));
  OK(mtdb_query_set_normals(query, 1, &error));
  OK(mtdb_select(object, query, &cut, &error));
  OK(mtdb_cut_stats(cut, &stats, &error));
  OK(mtdb_cut_details(cut, &details, &error));
  CHECK(details.row_bytes == info.row_bytes + 3 * sizeof(float));
  arrays.vertex_capacity = stats.vertices;
  arrays.triangle_capacity = stats.triangles;
  arrays.positions = malloc((size_t)stats.vertices * 3 * sizeof(double));
  arrays.indices = malloc((size_t)stats.triangles * 3 * sizeof(uint32_t));
  arrays.rows = malloc((size_t)stats.vertices * details.row_bytes);
  CHECK(arrays.positions != NULL && arrays.indices != NULL && arrays.rows != NULL);
  OK(mtdb_cut_copy(cut, &arrays, &error));
  for (i = 0; i < stats.vertices; ++i) {
    float n[3];
    memcpy(n, arrays.rows + i * details.row_bytes + info.row_bytes, sizeof(n));
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
  mtdb_code code;
};

/* Selects, with clusters read anew each time, until it is cancelled. */
static void* select_until_cancelled(void* argument) {
  struct selection* selection = argument;
  do {
    mtdb_object* cold = NULL;
    mtdb_cut* cut = NULL;
    selection->code = mtdb_open_object(database, NULL, 0, &cold, NULL);
    if (selection->code == MTDB_OK) {
      selection->code = mtdb_select(cold, selection->query, &cut, NULL);
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
  struct selection selection;
  pthread_t thread;
  mtdb_names* failures = NULL;
  uint64_t triangles = 0;
  long polls;
  int level;
  FAILS(MTDB_INVALID_ARGUMENT, "control", mtdb_create_control(NULL, &error));
  FAILS(MTDB_INVALID_ARGUMENT, "control", mtdb_control_progress(NULL, &progress, &error));
  FAILS(MTDB_INVALID_ARGUMENT, "query", mtdb_query_set_control(NULL, NULL, &error));
  mtdb_cancel(NULL);
  mtdb_free_control(NULL);

  /* A query whose control is watched, and not used. */
  OK(mtdb_create_control(&control, &error));
  FAILS(MTDB_INVALID_ARGUMENT, "progress", mtdb_control_progress(control, NULL, &error));
  OK(mtdb_create_query(&query, &error));
  OK(mtdb_query_set_control(query, control, &error));
  OK(mtdb_query_set_json(query, object, "{}", &error)); /* which leaves the control */
  OK(mtdb_control_progress(control, &progress, &error));
  CHECK(progress.nodes_applied == 0 && progress.triangles_emitted == 0 && !progress.cancelled);
  OK(mtdb_select(object, query, &cut, &error));
  memset(&sink, 0, sizeof(sink));
  sink.user = &triangles;
  sink.triangles = count_triangles;
  OK(mtdb_cut_emit(cut, &sink, &error));
  CHECK(triangles == info.triangles);
  OK(mtdb_control_progress(control, &progress, &error));
  CHECK(progress.triangles_emitted == info.triangles && !progress.cancelled);

  /* An emission that another thread stops between two blocks. */
  sink.user = control;
  sink.vertices = cancel_elsewhere;
  sink.triangles = NULL;
  FAILS(MTDB_CANCELLED, "", mtdb_cut_emit(cut, &sink, &error));
  CHECK(blocks >= 1);
  OK(mtdb_control_progress(control, &progress, &error));
  CHECK(progress.cancelled && progress.triangles_emitted == info.triangles);
  /* For ever after. The cut keeps what it needs of the control. */
  mtdb_free_control(control);
  memset(&sink, 0, sizeof(sink));
  FAILS(MTDB_CANCELLED, "", mtdb_cut_emit(cut, &sink, &error));
  mtdb_free_cut(cut);
  cut = NULL;
  FAILS(MTDB_CANCELLED, "", mtdb_select(object, query, &cut, &error));
  CHECK(cut == NULL);
  OK(mtdb_query_set_control(query, NULL, &error));
  OK(mtdb_select(object, query, &cut, &error));
  mtdb_free_cut(cut);

  /* Selections that go on in another thread. */
  OK(mtdb_create_control(&control, &error));
  OK(mtdb_query_set_control(query, control, &error));
  OK(mtdb_query_set_json(query, object, "{\"threshold\": {\"relative\": 1e-4}}", &error));
  selection.query = query;
  CHECK(pthread_create(&thread, NULL, select_until_cancelled, &selection) == 0);
  progress.nodes_applied = 0;
  for (polls = 0; progress.nodes_applied == 0 && polls < 10000000; ++polls) {
    OK(mtdb_control_progress(control, &progress, &error));
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
  mtdb_free_names(failures);
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
  OK(mtdb_closest_point(object, info.bounds_max, -1, HUGE_VAL, &hit, &error));
  CHECK(hit.found && hit.distance >= 0);
  OK(mtdb_cast_ray(object, info.bounds_max, down, -1, HUGE_VAL, &hit, &error));
}

/* What is kept from others: stores from packed files, passwords from messages. */
static void check_guards(const char* store) {
  char shown[64];
  FAILS(MTDB_ALREADY_EXISTS, "a store", mtdb_pack(database, NULL, 0, store, NULL, NULL, &error));
  OK(mtdb_without_secrets("a https://u:p@h/x?sig=1 b", shown, sizeof(shown), &error));
  CHECK(strcmp(shown, "a https://h/x b") == 0);
  OK(mtdb_without_secrets("https://u:p@h/x", shown, 6, &error));
  CHECK(strcmp(shown, "https") == 0);
  FAILS(MTDB_INVALID_ARGUMENT, "size", mtdb_without_secrets("a", shown, 0, &error));
  FAILS(MTDB_INVALID_ARGUMENT, "text", mtdb_without_secrets(NULL, shown, 6, &error));
  FAILS(MTDB_INVALID_ARGUMENT, "shown", mtdb_without_secrets("a", NULL, 6, &error));
}

int main(int argc, char** argv) {
  mtdb_open_options open_options;
  if (argc != 2) return 2;
  FAILS(MTDB_UNSUPPORTED, "ABI", mtdb_open_abi(MTDB_ABI_VERSION + 1, argv[1], &database, &error));
  FAILS(MTDB_UNSUPPORTED, "ABI",
        mtdb_open_with_abi(MTDB_ABI_VERSION + 1, argv[1], NULL, &database, &error));
  MTDB_INIT(open_options);
  open_options.struct_bytes = 1;
  FAILS(MTDB_INVALID_ARGUMENT, "struct_bytes",
        mtdb_open_with(argv[1], &open_options, &database, &error));
  MTDB_INIT(open_options);
  OK(mtdb_open_with(argv[1], &open_options, &database, &error));
  mtdb_free_database(database);
  OK(mtdb_open_with(argv[1], NULL, &database, &error));
  mtdb_free_database(database);
  OK(mtdb_open(argv[1], &database, &error));
  OK(mtdb_open_object(database, NULL, 0, &object, &error));
  check_guards(argv[1]);
  check_object();
  check_queries();
  check_bytes();
  check_available(NULL);
  check_available("{\"available_only\": true}");
  check_arrays();
  check_controls();
  check_probes();
  mtdb_free_database(database);
  mtdb_free_object(object);
  printf("all is well\n");
  return 0;
}
