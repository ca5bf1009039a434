/* SPDX-License-Identifier: Apache-2.0 */
/* mtdb for C: meshes that follow a query, of which only what changes travels. Begin with mtdb.h,
 * whose rules hold here.
 *
 * A session, beside the store, makes the bytes of an update stream (codecs/FORMAT.md); a client, in
 * the same process or in another, makes its mesh of them. mtdb_connect is a client of `mtdb serve`.
 * One thread at a time uses a session or a client.
 */
#ifndef MTDB_TOOLS_C_MTDB_FOLLOW_H
#define MTDB_TOOLS_C_MTDB_FOLLOW_H

#include "tools/c/mtdb.h"
#include "tools/c/mtdb_write.h"

#ifdef __cplusplus
extern "C" {
#endif

/* NOLINTBEGIN(readability-identifier-naming) */

typedef struct mtdb_session mtdb_session;
typedef struct mtdb_client mtdb_client;

/* What an update did. */
typedef struct mtdb_update {
  size_t struct_bytes;
  uint64_t triangles; /* of the mesh now, that of the whole cut */
  uint64_t vertices;
  uint64_t active_triangles; /* within their bound of the region */
  uint64_t insertions;       /* of vertices */
  uint64_t removals;
  uint64_t bytes; /* of the stream */
  double error_bound;
  double milliseconds;
  mtdb_limit limit;             /* what ended the refinement */
  uint64_t shortfall_triangles; /* as in mtdb_stats */
  double shortfall_excess;
  double shortfall_bounds_min[3];
  double shortfall_bounds_max[3];
} mtdb_update;

typedef struct mtdb_session_options {
  size_t struct_bytes;
  uint32_t remembered_vertices; /* how many removed vertices the client keeps, so that they need not
                                   travel again */
  uint32_t coded_holes;         /* of terrains; 1: the client is not to compute triangles, so that
                                   they travel, too */
} mtdb_session_options;
/* At the coarsest mesh. Some 200 to 600 bytes a triangle of the cut. */
MTDB_API mtdb_code mtdb_open_session(mtdb_object* object, const mtdb_session_options* options,
                                     mtdb_session** session, mtdb_error* error);
MTDB_API void mtdb_free_session(mtdb_session* session);
/* Moves to the cut of `query` (NULL: everything at full resolution), and hands the bytes of the
 * stream to `receive`, round after round; the first time the stream's beginning comes before them.
 * A query that clips clips the client. Normals are not sent. `update` may be NULL.
 *
 * On an error of the query the session goes on, and so do bytes that `receive` got. When `receive`
 * stops, the client lacks bytes that it should have: the session is closed, and later calls are
 * MTDB_INVALID_ARGUMENT. */
MTDB_API mtdb_code mtdb_update_session(mtdb_session* session, const mtdb_query* query,
                                       const mtdb_control* control, mtdb_receive receive,
                                       void* user, mtdb_update* update, mtdb_error* error);

typedef struct mtdb_client_options {
  size_t struct_bytes;
  uint32_t max_triangles; /* a stream with more is refused; 0: 2^26 */
  uint32_t max_vertices;  /* remembered ones included; 0: 2^25 */
} mtdb_client_options;
/* A client that is fed by hand. */
MTDB_API mtdb_code mtdb_create_client(const mtdb_client_options* options, mtdb_client** client,
                                      mtdb_error* error);
/* Bytes may come in any portions, and may be hostile. After an error the mesh is conforming, as the
 * last whole update left it, and more bytes are refused. */
MTDB_API mtdb_code mtdb_feed_client(mtdb_client* client, const unsigned char* bytes, size_t size,
                                    mtdb_error* error);

typedef struct mtdb_connect_options {
  size_t struct_bytes;
  const char* name;             /* of the object, when the URL has none */
  uint32_t remembered_vertices; /* 0: 65536 */
  uint32_t max_triangles;       /* 0: 2^24 */
  double timeout_seconds;       /* 0: 600 */
  double reconnect_seconds;     /* how long an update tries to replace a lost connection */
} mtdb_connect_options;
/* A client of a server: "http://HOST:PORT/objects/NAME". Starts with the coarsest mesh. Blocks. */
MTDB_API mtdb_code mtdb_connect(const char* url, const mtdb_connect_options* options,
                                mtdb_client** client, mtdb_error* error);
/* Asks the server (docs/query.md), and waits until the mesh is the answer. The watch is asked after
 * each message; the mesh is conforming then. Later calls go on after an error of the query, and
 * after the watch has stopped. MTDB_INVALID_ARGUMENT for a client that is fed by hand. */
MTDB_API mtdb_code mtdb_update_client(mtdb_client* client, const char* json,
                                      const mtdb_watch* watch, mtdb_update* update,
                                      mtdb_error* error);
MTDB_API void mtdb_free_client(mtdb_client* client);

/* Triangles and vertices lie in slots, which are used again: arrays for a GPU. A slot without a
 * triangle has the indices 0, 0, 0. */
typedef struct mtdb_client_view {
  size_t struct_bytes;
  uint64_t triangle_slots;
  uint64_t vertex_slots;
  uint64_t triangles; /* that there are */
  uint64_t vertices;
  const uint32_t* indices; /* triangle_slots * 3: vertex slots */
  const float* positions;  /* vertex_slots * 3, less origin */
  double origin[3];
  const unsigned char* rows; /* vertex_slots * row_bytes */
  uint32_t row_bytes;
  uint32_t attributes; /* how many: mtdb_get_client_attribute */
} mtdb_client_view;
/* Pointers are valid until the next call that changes the mesh. Before the stream's beginning all
 * is 0. */
MTDB_API mtdb_code mtdb_view_client(const mtdb_client* client, mtdb_client_view* view,
                                    mtdb_error* error);
/* Lives as long as the client. */
MTDB_API mtdb_code mtdb_get_client_attribute(const mtdb_client* client, uint32_t i,
                                             mtdb_attribute* attribute, mtdb_error* error);

typedef struct mtdb_changes {
  size_t struct_bytes;
  const uint32_t* triangles; /* triangle_ranges * 2: begin and end of the slots, ascending, apart */
  size_t triangle_ranges;
  const uint32_t* vertices;
  size_t vertex_ranges;
} mtdb_changes;
/* The slots that were written since the last call. Valid until the next one. */
MTDB_API mtdb_code mtdb_take_changes(mtdb_client* client, mtdb_changes* changes, mtdb_error* error);
/* The mesh without gaps, its positions as in the store. */
MTDB_API mtdb_code mtdb_get_client_mesh(const mtdb_client* client, mtdb_mesh** mesh,
                                        mtdb_error* error);

typedef struct mtdb_fetch_options {
  size_t struct_bytes;
  const char* name;       /* of the object, when the URL has none */
  const char* format;     /* "ply", or another that docs/protocol.md lists; NULL: "ply" */
  double timeout_seconds; /* 0: 600 */
} mtdb_fetch_options;
/* Gets one mesh of a server as the bytes of a file; of `update`, insertions, removals and
 * milliseconds are 0. */
MTDB_API mtdb_code mtdb_fetch(const char* url, const char* json, const mtdb_fetch_options* options,
                              mtdb_receive receive, void* user, mtdb_update* update,
                              mtdb_error* error);

/* NOLINTEND(readability-identifier-naming) */

#ifdef __cplusplus
}
#endif

#endif
