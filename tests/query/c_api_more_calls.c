/* SPDX-License-Identifier: Apache-2.0 */
/* c_api_more_calls FOLDER: calls every function of mtdb_write.h, mtdb_follow.h and mtdb_show.h from
 * C, rightly and wrongly, and prints the line of the first call that does not do what the header
 * says. FOLDER is empty. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "tests/query/c_api_checks.h"
#include "tests/query/c_api_mesh.h"
#include "tests/query/c_api_sheets_and_heights.h"
#include "tools/c/mtdb.h"
#include "tools/c/mtdb_follow.h"
#include "tools/c/mtdb_show.h"
#include "tools/c/mtdb_terrain.h"
#include "tools/c/mtdb_write.h"

static char folder[512];
static char store[600];
static char other[600];

static const char* path(char* to, const char* name) {
  snprintf(to, 600, "%s/%s", folder, name);
  return to;
}

static int reports;
static int count_reports(void* user, const char* stage, double overall) {
  CHECK(user == &reports && stage != NULL && overall <= 1);
  ++reports;
  return 0;
}
static int stop_at_once(void* user, const char* stage, double overall) {
  (void)user;
  (void)stage;
  (void)overall;
  return 1;
}

/* The part of an object's JSON that tells its content. */
static void digest_of(mtdb_database* database, const char* name, char digest[40]) {
  mtdb_object* object = NULL;
  mtdb_json* json = NULL;
  const char* at;
  OK(mtdb_open_object(database, name, NULL, &object, &error));
  OK(mtdb_get_object_json(object, &json, &error));
  at = strstr(mtdb_get_json_text(json), "\"digest\":\"");
  CHECK(at != NULL);
  memcpy(digest, at + 10, 32);
  digest[32] = '\0';
  mtdb_free_json(json);
  mtdb_free_object(object);
}

static void check_ingest(mtdb_database* database) {
  mtdb_input input = whole();
  mtdb_ingest_options options;
  mtdb_watch watch;
  mtdb_source source;
  mtdb_control* control = NULL;
  producing how = {0, 0};
  char first[40], second[40];
  MTDB_INIT(options);
  MTDB_INIT(watch);
  MTDB_INIT(source);
  watch.user = &reports;
  watch.progress = count_reports;
  options.threads = 1;
  OK(mtdb_ingest_arrays(database, "a", &input, &options, &watch, &error));
  CHECK(reports > 0);
  FAILS(MTDB_ALREADY_EXISTS, "a", mtdb_ingest_arrays(database, "a", &input, NULL, NULL, &error));
  options.replace = 1;
  input.positions = NULL;
  input.positions_float = floats;
  input.indices = NULL;
  input.indices_long = indices_long;
  digest_of(database, "a", first);
  OK(mtdb_ingest_arrays(database, "a", &input, &options, NULL, &error));
  digest_of(database, "a", second);
  CHECK(strcmp(first, second) == 0);

  /* In parts: the same object. */
  source.user = &how;
  source.produce = produce;
  source.attributes = kAttributes;
  source.attribute_count = 4;
  OK(mtdb_ingest_source(database, "parts", &source, NULL, NULL, &error));
  digest_of(database, "parts", second);
  CHECK(strcmp(first, second) == 0);
  how.stop_after = 3;
  FAILS(MTDB_CANCELLED, "callback",
        mtdb_ingest_source(database, "no", &source, NULL, NULL, &error));
  how.stop_after = 0;
  how.bad = 1;
  FAILS(MTDB_INVALID_ARGUMENT, "indices",
        mtdb_ingest_source(database, "no", &source, NULL, NULL, &error));
  source.produce = NULL;
  FAILS(MTDB_INVALID_ARGUMENT, "produce",
        mtdb_ingest_source(database, "no", &source, NULL, NULL, &error));
  FAILS(MTDB_INVALID_ARGUMENT, "ingest", mtdb_ingest_part(NULL, &input, &error));

  /* Stopped. */
  watch.progress = stop_at_once;
  FAILS(MTDB_CANCELLED, "callback",
        mtdb_ingest_arrays(database, "no", &input, NULL, &watch, &error));
  OK(mtdb_create_control(&control, &error));
  mtdb_cancel(control);
  watch.progress = NULL;
  watch.control = control;
  FAILS(MTDB_CANCELLED, "cancelled",
        mtdb_ingest_arrays(database, "no", &input, NULL, &watch, &error));
  mtdb_free_control(control);
}

/* What is up, and units, are kept as they are said. */
static void check_up_and_units(mtdb_database* database) {
  mtdb_input input = whole();
  mtdb_ingest_options options;
  mtdb_object* object = NULL;
  mtdb_json* json = NULL;
  MTDB_INIT(options);
  options.up[1] = -2;
  options.units = "mm";
  OK(mtdb_ingest_arrays(database, "up", &input, &options, NULL, &error));
  OK(mtdb_open_object(database, "up", NULL, &object, &error));
  OK(mtdb_get_object_json(object, &json, &error));
  CHECK(strstr(mtdb_get_json_text(json), "\"up\":[0.0,-1.0,0.0]") != NULL);
  CHECK(strstr(mtdb_get_json_text(json), "\"up_given\":true") != NULL);
  CHECK(strstr(mtdb_get_json_text(json), "\"units\":\"mm\"") != NULL);
  mtdb_free_json(json);
  mtdb_free_object(object);
  OK(mtdb_remove_object(database, "up", &error));
  options.units = "league";
  FAILS(MTDB_INVALID_ARGUMENT, "units",
        mtdb_ingest_arrays(database, "no", &input, &options, NULL, &error));
}

/* Arguments that make no sense. */
static void check_wrong_input(mtdb_database* database) {
  mtdb_input input = whole();
  mtdb_ingest_options options;
  mtdb_attribute attributes[4];
  uint32_t far_off[3] = {0, 1, kVertices};
  double nan_position[9] = {0, 0, 0, 1, 0, 0, 0, 1, 0};
#define WRONG(code, part) \
  FAILS(code, part, mtdb_ingest_arrays(database, "no", &input, &options, NULL, &error))
  MTDB_INIT(options);
  input.struct_bytes = 0;
  WRONG(MTDB_INVALID_ARGUMENT, "struct_bytes");
  input = whole();
  input.struct_bytes = sizeof(input) + 8; /* of a later version: what is behind must be 0 */
  {
    struct {
      mtdb_input input;
      uint64_t more;
    } later;
    later.input = input;
    later.more = 1;
    FAILS(MTDB_UNSUPPORTED, "members",
          mtdb_ingest_arrays(database, "no", &later.input, &options, NULL, &error));
  }
  input = whole();
  input.positions_float = floats;
  WRONG(MTDB_INVALID_ARGUMENT, "positions");
  input = whole();
  input.rows = NULL;
  WRONG(MTDB_INVALID_ARGUMENT, "rows");
  input = whole();
  input.vertices = (uint64_t)-1;
  WRONG(MTDB_INVALID_ARGUMENT, "input");
  input = whole();
  memcpy(attributes, kAttributes, sizeof(attributes));
  input.attributes = attributes;
  attributes[1].name = "red";
  WRONG(MTDB_INVALID_ARGUMENT, "twice");
  attributes[1].name = NULL;
  WRONG(MTDB_INVALID_ARGUMENT, "name");
  attributes[1] = kAttributes[1];
  attributes[2].type = (mtdb_scalar)77;
  WRONG(MTDB_INVALID_ARGUMENT, "type");
  attributes[2] = kAttributes[2];
  attributes[3].struct_bytes = 8; /* all have the size of the first */
  WRONG(MTDB_INVALID_ARGUMENT, "attributes[3].struct_bytes");
  input = whole();
  input.triangles = 1;
  input.indices = far_off;
  WRONG(MTDB_BAD_INPUT, "");
  input = whole();
  input.attribute_count = 0;
  input.vertices = 3;
  input.triangles = 1;
  nan_position[4] = nan("");
  input.positions = nan_position;
  WRONG(MTDB_BAD_INPUT, "");
  input.triangles = 0;
  nan_position[4] = 0;
  WRONG(MTDB_BAD_INPUT, "");
  input = whole();
  options.bits = 40;
  WRONG(MTDB_INVALID_ARGUMENT, "bits");
  options.bits = 12;
  options.lossless = 1;
  WRONG(MTDB_INVALID_ARGUMENT, "lossless");
  MTDB_INIT(options);
  options.resume = 1;
  WRONG(MTDB_INVALID_ARGUMENT, "resume");
  MTDB_INIT(options);
  options.threads = 5000;
  WRONG(MTDB_INVALID_ARGUMENT, "threads");
  MTDB_INIT(options);
  options.memory_bytes = 1000;
  WRONG(MTDB_INVALID_ARGUMENT, "");
  MTDB_INIT(options);
  options.attribute_step_count = 1;
  WRONG(MTDB_INVALID_ARGUMENT, "steps");
  FAILS(MTDB_INVALID_ARGUMENT, "database",
        mtdb_ingest_arrays(NULL, "no", &input, NULL, NULL, &error));
  FAILS(MTDB_INVALID_ARGUMENT, "name",
        mtdb_ingest_arrays(database, NULL, &input, NULL, NULL, &error));
  FAILS(MTDB_INVALID_ARGUMENT, "input",
        mtdb_ingest_arrays(database, "no", NULL, NULL, NULL, &error));
  FAILS(MTDB_INVALID_ARGUMENT, "", mtdb_ingest_arrays(database, "", &input, NULL, NULL, &error));
#undef WRONG
}

static void check_objects(mtdb_database* database) {
  mtdb_texts* names = NULL;
  mtdb_database* copy = NULL;
  mtdb_object* object = NULL;
  mtdb_sizes sizes;
  char first[40], second[40], packed[600], third[600];
  const char* which[1] = {"a"};
  const char* twice[2] = {"a", "a"};
  OK(mtdb_rename_object(database, "parts", "b", &error));
  FAILS(MTDB_ALREADY_EXISTS, "", mtdb_rename_object(database, "a", "b", &error));
  FAILS(MTDB_NOT_FOUND, "", mtdb_rename_object(database, "none", "c", &error));
  FAILS(MTDB_INVALID_ARGUMENT, "new_name", mtdb_rename_object(database, "a", NULL, &error));
  OK(mtdb_copy_store(database, path(other, "copy.mtdb"), NULL, &error));
  FAILS(MTDB_ALREADY_EXISTS, "", mtdb_copy_store(database, other, NULL, &error));
  OK(mtdb_open_writable(other, &copy, &error));
  OK(mtdb_remove_object(copy, "b", &error));
  FAILS(MTDB_NOT_FOUND, "", mtdb_remove_object(copy, "b", &error));
  FAILS(MTDB_INVALID_ARGUMENT, "name", mtdb_remove_object(copy, NULL, &error));
  OK(mtdb_open_object(database, "b", NULL, &object, &error));
  OK(mtdb_copy_object(object, copy, "c", 0, NULL, &error));
  FAILS(MTDB_ALREADY_EXISTS, "", mtdb_copy_object(object, copy, "c", 0, NULL, &error));
  OK(mtdb_copy_object(object, copy, "c", 1, NULL, &error));
  FAILS(MTDB_INVALID_ARGUMENT, "target", mtdb_copy_object(object, NULL, "c", 1, NULL, &error));
  mtdb_free_object(object);
  digest_of(database, "b", first);
  digest_of(copy, "c", second);
  CHECK(strcmp(first, second) == 0);
  OK(mtdb_list_objects(copy, &names, &error));
  CHECK(mtdb_count_texts(names) == 2 && strcmp(mtdb_get_text(names, 1), "c") == 0);
  mtdb_free_texts(names);
  MTDB_INIT(sizes);
  OK(mtdb_pack(copy, which, 1, path(packed, "a.mtdbp"), NULL, &sizes, &error));
  CHECK(sizes.bytes_after > 0 && sizes.first_bytes > 0);
  FAILS(MTDB_INVALID_ARGUMENT, "twice",
        mtdb_pack(copy, twice, 2, path(third, "no"), NULL, &sizes, &error));
  FAILS(MTDB_INVALID_ARGUMENT, "names", mtdb_pack(copy, NULL, 1, third, NULL, &sizes, &error));
  OK(mtdb_pack(copy, NULL, 0, packed, NULL, NULL, &error));
  mtdb_free_database(copy);
  OK(mtdb_compact_store(other, NULL, &sizes, &error));
  CHECK(sizes.bytes_after <= sizes.bytes_before);
  FAILS(MTDB_INVALID_ARGUMENT, "path", mtdb_compact_store(NULL, NULL, NULL, &error));
  OK(mtdb_open(packed, NULL, &copy, &error));
  digest_of(copy, "a", second);
  digest_of(database, "a", first);
  CHECK(strcmp(first, second) == 0);
  FAILS(MTDB_INVALID_ARGUMENT, "", mtdb_remove_object(copy, "a", &error));        /* is read only */
  OK(mtdb_unpack(copy, which, 1, path(third, "unpacked.mtdb"), 0, NULL, &error)); /* a new one */
  FAILS(MTDB_ALREADY_EXISTS, "a", mtdb_unpack(copy, which, 1, third, 0, NULL, &error));
  OK(mtdb_unpack(copy, NULL, 0, third, 1, NULL, &error)); /* into it */
  FAILS(MTDB_INVALID_ARGUMENT, "twice", mtdb_unpack(copy, twice, 2, third, 1, NULL, &error));
  FAILS(MTDB_INVALID_ARGUMENT, "packed", mtdb_unpack(database, NULL, 0, third, 1, NULL, &error));
  mtdb_free_database(copy);
  OK(mtdb_open(third, NULL, &copy, &error));
  digest_of(copy, "a", second);
  CHECK(strcmp(first, second) == 0);
  mtdb_free_database(copy);
  FAILS(MTDB_UNSUPPORTED, "ABI", mtdb_open_writable_abi(0, store, &copy, &error));
}

/* What a file has of the mesh is told, and what cannot be as asked for is refused. */
static void check_file_options(mtdb_cut* cut, const mtdb_mesh* mesh) {
  mtdb_file_options options;
  mtdb_json* json = NULL;
  char file[600];
  MTDB_INIT(options);
  OK(mtdb_write_mesh(mesh, path(file, "as.ply"), NULL, &json, &error));
  CHECK(strstr(mtdb_get_json_text(json), "\"positions\":\"float32\"") != NULL);
  CHECK(strstr(mtdb_get_json_text(json), "\"rounding\":") != NULL);
  mtdb_free_json(json);
  options.double_positions = 1;
  OK(mtdb_write_cut(cut, file, &options, &json, &error));
  CHECK(strstr(mtdb_get_json_text(json), "\"positions\":\"float64\"") != NULL);
  mtdb_free_json(json);
  OK(mtdb_write_mesh(mesh, file, &options, NULL, &error));
  FAILS(MTDB_INVALID_ARGUMENT, "float64",
        mtdb_write_mesh(mesh, path(file, "as.stl"), &options, NULL, &error));
  options.double_positions = 0;
  OK(mtdb_write_cut(cut, file, &options, &json, &error));
  CHECK(strstr(mtdb_get_json_text(json), "heat") != NULL); /* not written */
  mtdb_free_json(json);
  options.struct_bytes = 0;
  FAILS(MTDB_INVALID_ARGUMENT, "struct_bytes", mtdb_write_cut(cut, file, &options, NULL, &error));
}

static void check_meshes(mtdb_object* object) {
  mtdb_cut* cut = NULL;
  mtdb_mesh* mesh = NULL;
  mtdb_mesh* read = NULL;
  mtdb_mesh_view view, again;
  mtdb_stats stats;
  mtdb_attribute attribute;
  mtdb_input input = whole();
  mtdb_database* database = NULL;
  uint64_t i;
  const double origin[3] = {1, 2, 0.5};
  const double bad_origin[3] = {1, HUGE_VAL, 0.5};
  char file[600], archive[600];
  MTDB_INIT(view);
  MTDB_INIT(again);
  MTDB_INIT(stats);
  MTDB_INIT(attribute);
  OK(mtdb_select(object, NULL, NULL, &cut, &error));
  OK(mtdb_get_cut_stats(cut, &stats, &error));
  OK(mtdb_get_cut_mesh(cut, NULL, &mesh, &error));
  OK(mtdb_view_mesh(mesh, &view, &error));
  CHECK(view.vertices == stats.vertices && view.triangles == stats.triangles);
  CHECK(view.positions != NULL && view.positions_float == NULL && view.row_bytes == sizeof(row));
  OK(mtdb_get_mesh_attribute(mesh, 3, &attribute, &error));
  CHECK(strcmp(attribute.name, "heat") == 0 && attribute.offset == 3);
  FAILS(MTDB_NOT_FOUND, "4", mtdb_get_mesh_attribute(mesh, 4, &attribute, &error));
  for (i = 0; i < view.vertices; ++i) { /* the rows belong to the positions */
    float heat;
    memcpy(&heat, view.rows + i * view.row_bytes + 3, sizeof(heat));
    CHECK(fabs(0.25 * heat - view.positions[3 * i]) < 0.01);
  }
  OK(mtdb_write_mesh(mesh, path(file, "mesh.ply"), NULL, NULL, &error));
  FAILS(MTDB_UNSUPPORTED, "", mtdb_write_mesh(mesh, path(archive, "x.zip"), NULL, NULL, &error));
  OK(mtdb_read_mesh(file, &read, &error));
  OK(mtdb_view_mesh(read, &again, &error));
  CHECK(again.vertices == view.vertices && again.triangles == view.triangles);
  CHECK(memcmp(again.indices, view.indices, (size_t)view.triangles * 12) == 0);
  mtdb_free_mesh(read);
  check_file_options(cut, mesh);
  OK(mtdb_write_cut(cut, path(file, "cut.ply"), NULL, NULL, &error));
  OK(mtdb_open_writable(path(archive, "file.mtdb"), &database, &error));
  OK(mtdb_ingest_file(database, "from file", file, NULL, NULL, &error));
  FAILS(MTDB_NOT_FOUND, "none.ply",
        mtdb_ingest_file(database, "no", "none.ply", NULL, NULL, &error));
  mtdb_free_database(database);
  FAILS(MTDB_NOT_FOUND, "none.ply", mtdb_read_mesh("none.ply", &read, &error));
  mtdb_free_mesh(mesh);

  OK(mtdb_get_cut_mesh(cut, origin, &mesh, &error));
  OK(mtdb_view_mesh(mesh, &again, &error));
  CHECK(again.positions == NULL && again.positions_float != NULL && again.origin[1] == 2);
  mtdb_free_mesh(mesh);
  FAILS(MTDB_INVALID_ARGUMENT, "origin", mtdb_get_cut_mesh(cut, bad_origin, &mesh, &error));
  FAILS(MTDB_INVALID_ARGUMENT, "mesh", mtdb_get_cut_mesh(cut, NULL, NULL, &error));
  FAILS(MTDB_INVALID_ARGUMENT, "cut", mtdb_get_cut_mesh(NULL, NULL, &mesh, &error));
  again.struct_bytes = 0;
  mtdb_free_cut(cut);

  OK(mtdb_create_mesh(&input, &mesh, &error));
  FAILS(MTDB_INVALID_ARGUMENT, "struct_bytes", mtdb_view_mesh(mesh, &again, &error));
  FAILS(MTDB_INVALID_ARGUMENT, "view", mtdb_view_mesh(mesh, NULL, &error));
  again.struct_bytes = offsetof(mtdb_mesh_view, positions); /* a program of an older version */
  again.positions = positions;
  OK(mtdb_view_mesh(mesh, &again, &error));
  CHECK(again.vertices == kVertices && again.positions == positions);
  mtdb_free_mesh(mesh);
  indices[5] = kVertices;
  FAILS(MTDB_BAD_INPUT, "triangle 1", mtdb_create_mesh(&input, &mesh, &error));
  indices[5] = kSide;
  FAILS(MTDB_INVALID_ARGUMENT, "input", mtdb_create_mesh(NULL, &mesh, &error));
}

/* Feeds a client some bytes at a time. */
static int feed(void* user, const unsigned char* bytes, size_t size) {
  size_t at;
  for (at = 0; at < size; at += 1000) {
    const size_t some = size - at < 1000 ? size - at : 1000;
    if (mtdb_feed_client((mtdb_client*)user, bytes + at, some, &error) != MTDB_OK) return 1;
  }
  return 0;
}
static int refuse(void* user, const unsigned char* bytes, size_t size) {
  (void)user;
  (void)bytes;
  return size > 0;
}

static void check_session(mtdb_object* object) {
  mtdb_session* session = NULL;
  mtdb_client* client = NULL;
  mtdb_query* query = NULL;
  mtdb_update update;
  mtdb_client_view view;
  mtdb_changes changes;
  mtdb_mesh* mesh = NULL;
  mtdb_mesh_view compact;
  mtdb_attribute attribute;
  mtdb_session_options options;
  uint64_t whole_triangles;
  MTDB_INIT(update);
  MTDB_INIT(view);
  MTDB_INIT(changes);
  MTDB_INIT(compact);
  MTDB_INIT(attribute);
  MTDB_INIT(options);
  options.remembered_vertices = 1000;
  OK(mtdb_open_session(object, &options, &session, &error));
  OK(mtdb_create_client(NULL, &client, &error));
  OK(mtdb_view_client(client, &view, &error));
  CHECK(view.triangles == 0 && view.indices == NULL);
  OK(mtdb_take_changes(client, &changes, &error));
  CHECK(changes.triangle_ranges == 0);
  FAILS(MTDB_INVALID_ARGUMENT, "begun", mtdb_get_client_mesh(client, &mesh, &error));
  OK(mtdb_update_session(session, NULL, NULL, feed, client, &update, &error));
  OK(mtdb_view_client(client, &view, &error));
  CHECK(update.insertions > 0 && update.bytes > 0 && view.triangles == update.triangles);
  whole_triangles = update.triangles;
  OK(mtdb_take_changes(client, &changes, &error));
  CHECK(changes.triangle_ranges > 0 && changes.triangles[1] > changes.triangles[0]);
  OK(mtdb_get_client_attribute(client, 0, &attribute, &error));
  CHECK(strcmp(attribute.name, "red") == 0);
  OK(mtdb_create_query(object, "{\"region\": {\"box\": {\"min\": [0, 0, -9], \"max\": [5, 5, 9]}}}",
                       &query, &error));
  OK(mtdb_update_session(session, query, NULL, feed, client, &update, &error));
  CHECK(update.removals > 0 && update.triangles < whole_triangles);
  OK(mtdb_get_client_mesh(client, &mesh, &error));
  OK(mtdb_view_mesh(mesh, &compact, &error));
  CHECK(compact.triangles == update.triangles && compact.vertices == update.vertices);
  mtdb_free_mesh(mesh);
  mtdb_free_query(query);
  OK(mtdb_create_query(
      object, "{\"region\": {\"box\": {\"min\": [0, 0, -9], \"max\": [5, 5, 9]}}, \"clip\": true}",
      &query, &error));
  OK(mtdb_update_session(session, query, NULL, feed, client, &update, &error));
  OK(mtdb_view_client(client, &view, &error));
  CHECK(view.triangles < update.triangles && view.triangles == update.active_triangles);
  FAILS(MTDB_CANCELLED, "callback",
        mtdb_update_session(session, NULL, NULL, refuse, NULL, &update, &error));
  FAILS(MTDB_INVALID_ARGUMENT, "lacks",
        mtdb_update_session(session, NULL, NULL, feed, client, &update, &error));
  FAILS(MTDB_INVALID_ARGUMENT, "receive",
        mtdb_update_session(session, NULL, NULL, NULL, client, &update, &error));
  FAILS(MTDB_INVALID_ARGUMENT, "server", mtdb_update_client(client, "{}", NULL, NULL, &error));
  mtdb_free_client(client);
  OK(mtdb_create_client(NULL, &client, &error));
  FAILS(MTDB_CORRUPT, "", mtdb_feed_client(client, (const unsigned char*)"nonsense", 8, &error));
  mtdb_free_client(client);
  mtdb_free_session(session);
  mtdb_free_query(query);
  FAILS(MTDB_INVALID_ARGUMENT, "object", mtdb_open_session(NULL, NULL, &session, &error));
  FAILS(MTDB_INVALID_ARGUMENT, "client", mtdb_create_client(NULL, NULL, &error));
}

static size_t fetched;
static int count_bytes(void* user, const unsigned char* bytes, size_t size) {
  (void)bytes;
  CHECK(user == &fetched);
  fetched += size;
  return 0;
}

static void check_server(void) {
  mtdb_server* server = NULL;
  mtdb_server* second = NULL;
  mtdb_client* client = NULL;
  mtdb_update update;
  mtdb_client_view view;
  mtdb_connect_options connect;
  mtdb_fetch_options fetch;
  mtdb_serve_options options;
  mtdb_watch watch;
  char url[200];
  MTDB_INIT(update);
  MTDB_INIT(view);
  MTDB_INIT(connect);
  MTDB_INIT(fetch);
  MTDB_INIT(options);
  MTDB_INIT(watch);
  options.threads = 1;
  OK(mtdb_serve(store, &options, &server, &error));
  OK(mtdb_serve(store, &options, &second, &error)); /* several in one process */
  CHECK(strcmp(mtdb_get_server_url(server), mtdb_get_server_url(second)) != 0);
  mtdb_free_server(second);
  snprintf(url, sizeof(url), "%s/objects/a", mtdb_get_server_url(server));
  connect.timeout_seconds = 60;
  OK(mtdb_connect(url, &connect, &client, &error));
  OK(mtdb_view_client(client, &view, &error));
  CHECK(view.triangles > 0);
  OK(mtdb_update_client(client, "{\"threshold\": \"full\"}", NULL, &update, &error));
  OK(mtdb_view_client(client, &view, &error));
  CHECK(view.triangles == update.triangles && update.insertions > 0 && update.error_bound >= 0);
  FAILS(MTDB_INVALID_ARGUMENT, "nothing",
        mtdb_update_client(client, "{\"nothing\": 1}", NULL, &update, &error));
  watch.progress = stop_at_once;
  FAILS(
      MTDB_CANCELLED, "callback",
      mtdb_update_client(client, "{\"threshold\": {\"relative\": 0.1}}", &watch, &update, &error));
  OK(mtdb_update_client(client, "{\"threshold\": \"full\"}", NULL, NULL, &error));
  FAILS(MTDB_INVALID_ARGUMENT, "server",
        mtdb_feed_client(client, (const unsigned char*)"x", 1, &error));
  mtdb_free_client(client);
  OK(mtdb_fetch(url, "{}", &fetch, count_bytes, &fetched, &update, &error));
  CHECK(fetched == update.bytes && update.triangles == kTriangles);
  FAILS(MTDB_CANCELLED, "", mtdb_fetch(url, "{}", NULL, refuse, NULL, NULL, &error));
  FAILS(MTDB_INVALID_ARGUMENT, "receive", mtdb_fetch(url, "{}", NULL, NULL, NULL, NULL, &error));
  OK(mtdb_stop_server(server, 1, &error));
  FAILS(MTDB_IO_ERROR, "", mtdb_connect(url, NULL, &client, &error));
  mtdb_free_server(server);
  options.address = "nowhere";
  FAILS(MTDB_INVALID_ARGUMENT, "nowhere", mtdb_serve(store, &options, &server, &error));
  options.address = NULL;
  options.port = 70000;
  FAILS(MTDB_INVALID_ARGUMENT, "port", mtdb_serve(store, &options, &server, &error));
  FAILS(MTDB_NOT_FOUND, "none.mtdb", mtdb_serve("none.mtdb", NULL, &server, &error));
  FAILS(MTDB_INVALID_ARGUMENT, "server", mtdb_stop_server(NULL, 0, &error));
  CHECK(mtdb_get_server_url(NULL) == NULL);
}

static size_t differences(const unsigned char* a, const unsigned char* b, size_t bytes) {
  size_t i, different = 0;
  for (i = 0; i < bytes; ++i) different += a[i] != b[i];
  return different;
}

/* Every way of drawing gives another picture, and what cannot be drawn is refused. */
static void check_picture_styles(const mtdb_mesh* mesh) {
  static unsigned char plain[80 * 60 * 3], drawn[80 * 60 * 4];
  mtdb_render_options options, with;
  char file[600];
  size_t i, clear = 0;
  MTDB_INIT(options);
  options.width = 80;
  options.height = 60;
  OK(mtdb_render(mesh, &options, plain, sizeof(plain), &error));
#define DIFFERS(change)                                       \
  with = options;                                             \
  with.change;                                                \
  OK(mtdb_render(mesh, &with, drawn, sizeof(plain), &error)); \
  CHECK(differences(plain, drawn, sizeof(plain)) > 100);
  DIFFERS(view = "top")
  DIFFERS(up[1] = 1)
  DIFFERS(smooth = 1)
  DIFFERS(draft = 1)
  DIFFERS(hillshade = 1)
  DIFFERS(colour = MTDB_COLOUR_HEIGHT)
  DIFFERS(colour = MTDB_COLOUR_NORMAL)
  DIFFERS(scale_bar = 1)
  DIFFERS(has_background = 1)
  with = options;
  with.transparent = 1;
  FAILS(MTDB_BUDGET_EXCEEDED, "pixels", mtdb_render(mesh, &with, drawn, sizeof(plain), &error));
  OK(mtdb_render(mesh, &with, drawn, sizeof(drawn), &error));
  for (i = 3; i < sizeof(drawn); i += 4) clear += drawn[i] == 0;
  CHECK(clear > 100 && clear < 4000);
  OK(mtdb_write_png(path(file, "clear.png"), drawn, 80, 60, 4, &error));
  FAILS(MTDB_INVALID_ARGUMENT, "channels", mtdb_write_png(file, drawn, 80, 60, 2, &error));
  with = options;
  with.colour = MTDB_COLOUR_DISTANCE;
  FAILS(MTDB_INVALID_ARGUMENT, "reference", mtdb_render(mesh, &with, drawn, sizeof(plain), &error));
  with.reference = mesh;
  with.has_range = 1;
  with.range[1] = 1;
  OK(mtdb_render(mesh, &with, drawn, sizeof(plain), &error));
  CHECK(differences(plain, drawn, sizeof(plain)) > 100);
  with.colour = MTDB_COLOUR_ATTRIBUTE;
  FAILS(MTDB_INVALID_ARGUMENT, "attribute", mtdb_render(mesh, &with, drawn, sizeof(plain), &error));
  with.attribute = "nothing";
  FAILS(MTDB_INVALID_ARGUMENT, "nothing", mtdb_render(mesh, &with, drawn, sizeof(plain), &error));
  with.colour = (mtdb_colour)6;
  FAILS(MTDB_INVALID_ARGUMENT, "colour", mtdb_render(mesh, &with, drawn, sizeof(plain), &error));
  with = options;
  with.view = "behind";
  FAILS(MTDB_INVALID_ARGUMENT, "behind", mtdb_render(mesh, &with, drawn, sizeof(plain), &error));
  options.has_frame = 1; /* triangles far larger than pixels */
  options.frame_max[0] = options.frame_max[1] = 2;
  OK(mtdb_render(mesh, &options, plain, sizeof(plain), &error));
  DIFFERS(wireframe = 1)
#undef DIFFERS
}

static void check_pictures(void) {
  mtdb_input input = whole();
  mtdb_mesh* mesh = NULL;
  mtdb_render_options options;
  static unsigned char rgb[80 * 60 * 3];
  char file[600];
  size_t i, different = 0;
  MTDB_INIT(options);
  OK(mtdb_create_mesh(&input, &mesh, &error));
  options.width = 80;
  options.height = 60;
  OK(mtdb_render(mesh, &options, rgb, sizeof(rgb), &error));
  for (i = 3; i < sizeof(rgb); ++i) different += rgb[i] != rgb[i % 3];
  CHECK(different > 1000);
  OK(mtdb_write_png(path(file, "picture.png"), rgb, 80, 60, 3, &error));
  FAILS(MTDB_INVALID_ARGUMENT, "width", mtdb_write_png(file, rgb, 0, 60, 3, &error));
  options.has_camera = 1;
  options.eye[2] = 50;
  options.target[0] = 5;
  options.up[1] = 1;
  OK(mtdb_render(mesh, &options, rgb, sizeof(rgb), &error));
  options.eye[2] = options.target[2] = 0;
  options.eye[0] = options.target[0];
  FAILS(MTDB_INVALID_ARGUMENT, "", mtdb_render(mesh, &options, rgb, sizeof(rgb), &error));
  FAILS(MTDB_BUDGET_EXCEEDED, "pixels", mtdb_render(mesh, NULL, rgb, sizeof(rgb), &error));
  options.has_camera = 0;
  options.has_frame = 1;
  options.frame_min[0] = 1;
  FAILS(MTDB_INVALID_ARGUMENT, "frame", mtdb_render(mesh, &options, rgb, sizeof(rgb), &error));
  options.width = 100000;
  FAILS(MTDB_INVALID_ARGUMENT, "16384", mtdb_render(mesh, &options, rgb, sizeof(rgb), &error));
  check_picture_styles(mesh);
  mtdb_free_mesh(mesh);
  FAILS(MTDB_INVALID_ARGUMENT, "mesh", mtdb_render(NULL, NULL, rgb, sizeof(rgb), &error));
}

enum { kColumns = 30, kRows = 20 };
static double input_heights[kRows * kColumns], read_heights[kRows * kColumns];

static void write_grid(const char* file) {
  FILE* out = fopen(file, "w");
  int i;
  CHECK(out != NULL);
  fprintf(out, "ncols %d\nnrows %d\nxllcenter 100\nyllcenter 200\ncellsize 2\n", kColumns, kRows);
  fprintf(out, "NODATA_value -9999\n");
  for (i = 0; i < kRows * kColumns; ++i) {
    fprintf(out, "%g ", isnan(input_heights[i]) ? -9999 : input_heights[i]);
  }
  CHECK(fclose(out) == 0);
}

/* All heights come back as they were, by samples, by places and along a line. */
static void check_heights(mtdb_object* terrain) {
  mtdb_probe_options options;
  mtdb_height_cost cost;
  mtdb_raster raster;
  mtdb_profile* profile = NULL;
  double places[4] = {100, 200, 0, 0}, found[2], window[4] = {100, 200, 104, 204},
         spacing[2] = {1, 1};
  int i;
  MTDB_INIT(options);
  MTDB_INIT(cost);
  MTDB_INIT(raster);
  OK(mtdb_get_raster(terrain, NULL, NULL, &raster, &error));
  CHECK(raster.columns == kColumns && raster.rows == kRows && raster.dx == 2 && raster.dy == -2);
  CHECK(raster.x0 == 100 && raster.y0 == 200 + 2 * (kRows - 1));
  OK(mtdb_sample_heights(terrain, &raster, NULL, read_heights, kRows * kColumns, &cost, &error));
  CHECK(cost.error_bound == 0 && cost.clusters_read > 0);
  for (i = 0; i < kRows * kColumns; ++i) {
    CHECK(isnan(input_heights[i]) ? isnan(read_heights[i]) : read_heights[i] == input_heights[i]);
  }
  options.error = 3;
  OK(mtdb_sample_heights(terrain, &raster, &options, read_heights, kRows * kColumns, &cost,
                         &error));
  CHECK(cost.error_bound > 0 && cost.error_bound <= 3);
  for (i = 0; i < kRows * kColumns; ++i) {
    CHECK(isnan(read_heights[i]) || fabs(read_heights[i] - input_heights[i]) <= 3);
  }
  FAILS(MTDB_BUDGET_EXCEEDED, "600",
        mtdb_sample_heights(terrain, &raster, NULL, read_heights, 599, &cost, &error));
  OK(mtdb_get_raster(terrain, window, spacing, &raster, &error));
  CHECK(raster.columns == 5 && raster.rows == 5);
  window[0] = 1000;
  FAILS(MTDB_INVALID_ARGUMENT, "window", mtdb_get_raster(terrain, window, NULL, &raster, &error));
  OK(mtdb_find_heights(terrain, places, 2, NULL, found, &cost, &error));
  CHECK(found[0] == input_heights[(kRows - 1) * kColumns] && isnan(found[1]));
  options.error = -1;
  FAILS(MTDB_INVALID_ARGUMENT, "options.error",
        mtdb_find_heights(terrain, places, 2, &options, found, NULL, &error));
  check_height_changes(terrain);
  places[2] = 106, places[3] = 200; /* three samples on */
  OK(mtdb_find_profile(terrain, places, 2, NULL, &profile, &cost, &error));
  CHECK(mtdb_count_profile_points(profile) >= 4);
  for (i = 0; i < 4; ++i) {
    size_t at;
    int seen = 0;
    for (at = 0; at < mtdb_count_profile_points(profile); ++at) {
      const double* point = mtdb_get_profile_points(profile) + 4 * at;
      seen |= fabs(point[0] - 2 * i) < 1e-9 && point[2] == 200 &&
              fabs(point[3] - input_heights[(kRows - 1) * kColumns + i]) < 1e-9;
    }
    CHECK(seen);
  }
  mtdb_free_profile(profile);
  FAILS(MTDB_INVALID_ARGUMENT, "",
        mtdb_find_profile(terrain, places, 1, NULL, &profile, NULL, &error));
}

static void check_terrains(mtdb_database* database, mtdb_object* mesh) {
  mtdb_height_array array;
  mtdb_ingest_options options;
  mtdb_object* terrain = NULL;
  mtdb_raster raster;
  mtdb_json* json = NULL;
  char file[600];
  const char* files[2];
  const double step[6] = {100, 2, 0, 200 + 2 * (kRows - 1), 0, -2};
  int i;
  for (i = 0; i < kRows * kColumns; ++i) {
    input_heights[i] = floor(20 * sin(i % kColumns * 0.3) + (i / kColumns) * 1.7);
  }
  input_heights[5 * kColumns + 7] = input_heights[5 * kColumns + 8] = NAN;
  MTDB_INIT(array);
  MTDB_INIT(options);
  MTDB_INIT(raster);
  array.columns = kColumns;
  array.rows = kRows;
  array.heights = input_heights;
  memcpy(array.geotransform, step, sizeof(step));
  array.height_units = "m";
  OK(mtdb_ingest_heights(database, "array", &array, NULL, NULL, &error));
  OK(mtdb_open_object(database, "array", NULL, &terrain, &error));
  check_heights(terrain);
  mtdb_free_object(terrain);
  files[0] = files[1] = path(file, "grid.asc");
  write_grid(file);
  OK(mtdb_ingest_rasters(database, "joined", files, 2, NULL, NULL, &error));
  OK(mtdb_open_object(database, "joined", NULL, &terrain, &error));
  check_heights(terrain);
  mtdb_free_object(terrain);
  OK(mtdb_ingest_file(database, "file", file, NULL, NULL, &error));
  FAILS(MTDB_INVALID_ARGUMENT, "no raster",
        mtdb_ingest_rasters(database, "x", files, 0, NULL, NULL, &error));
  options.bits = 16;
  FAILS(MTDB_INVALID_ARGUMENT, "height_step",
        mtdb_ingest_heights(database, "x", &array, &options, NULL, &error));
  options.bits = 0;
  input_heights[0] += 0.25;
  OK(mtdb_ingest_heights(database, "decimals", &array, NULL, NULL, &error));
  options.height_step = 0.25;
  OK(mtdb_ingest_heights(database, "quarters", &array, &options, NULL, &error));
  array.rows = 1;
  FAILS(MTDB_INVALID_ARGUMENT, "rows",
        mtdb_ingest_heights(database, "x", &array, &options, NULL, &error));
  FAILS(MTDB_INVALID_ARGUMENT, "raster", mtdb_get_raster(mesh, NULL, NULL, &raster, &error));
  FAILS(MTDB_INVALID_ARGUMENT, "terrain", mtdb_compare_heights(mesh, mesh, NULL, &json, &error));
  FAILS(MTDB_INVALID_ARGUMENT, "terrain",
        mtdb_find_heights(mesh, step, 1, NULL, read_heights, NULL, &error));
  CHECK(mtdb_count_profile_points(NULL) == 0 && mtdb_get_profile_points(NULL) == NULL);
  mtdb_free_profile(NULL);
}

int main(int argc, char** argv) {
  mtdb_database* database = NULL;
  mtdb_object* object = NULL;
  if (argc != 2) return 2;
  snprintf(folder, sizeof(folder), "%s", argv[1]);
  make_mesh();
  OK(mtdb_open_writable(path(store, "a.mtdb"), &database, &error));
  check_ingest(database);
  check_up_and_units(database);
  check_orient(database);
  check_wrong_input(database);
  check_objects(database);
  OK(mtdb_open_object(database, "a", NULL, &object, &error));
  check_terrains(database, object);
  mtdb_free_database(database);
  check_meshes(object);
  check_session(object);
  mtdb_free_object(object);
  check_server();
  check_pictures();
  mtdb_free_mesh(NULL);
  mtdb_free_session(NULL);
  mtdb_free_client(NULL);
  mtdb_free_server(NULL);
  puts("all calls are right");
  return 0;
}
