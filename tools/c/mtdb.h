/* SPDX-License-Identifier: Apache-2.0 */
/* mtdb for C, and for every language that can call C: libmtdb.so. This header reads stores;
 * mtdb_write.h makes them, mtdb_follow.h keeps meshes that follow a query, mtdb_show.h draws and
 * serves.
 *
 *   mtdb_error error;
 *   mtdb_database* database = NULL;
 *   if (mtdb_open("scans.mtdb", NULL, &database, &error) != MTDB_OK) puts(error.message);
 *
 * tools/example_c.c is a whole program. Rules that hold everywhere:
 *
 * - A call that can fail returns an mtdb_code and takes an mtdb_error, which may be NULL. Results
 *   are written on MTDB_OK only. Nothing is printed, and there is no global state.
 * - Each kind of handle has its mtdb_free_...; freeing NULL does nothing. A handle keeps what it
 *   needs of the handle that it was made from: handles may be freed in any order.
 * - A NULL where something is needed, and numbers that make no sense, are MTDB_INVALID_ARGUMENT.
 * - Many threads at once may use a database, an object, a query or a control; one thread at a time
 *   may use a cut.
 * - Lengths are in the object's units; texts are UTF-8 with a 0 at the end.
 * - A name says what is done and then to what: mtdb_write_mesh; a "get" only tells.
 * - Structs but mtdb_error begin with struct_bytes, and may grow: a program sets them up by
 *   MTDB_INIT (or sets struct_bytes to their size, and all else to 0), also those that the library
 *   fills in, and goes on working with later libraries. In options, 0 and NULL stand for the
 *   default; a NULL in place of the whole struct for all defaults. In an array of structs all have
 *   the size of the first.
 * - Whatever a query can ask for is said in JSON (docs/query.md), here as everywhere else; there
 *   are no functions for parts of it. In numbers JSON has a point, whatever the locale.
 *
 * The interface grows by new functions and structs; a change of an existing one raises
 * MTDB_ABI_VERSION. mtdb_create_query takes new kinds of regions and thresholds as they come.
 */
#ifndef MTDB_TOOLS_C_MTDB_H
#define MTDB_TOOLS_C_MTDB_H

#include <stddef.h>
#include <stdint.h>
#include <string.h>

#ifdef __cplusplus
extern "C" {
#endif

/* NOLINTBEGIN(readability-identifier-naming) */

/* The version of the interface that a program was compiled for. mtdb_open compares it with the
 * library's. */
#define MTDB_ABI_VERSION 1u

#if defined(__GNUC__)
#define MTDB_API __attribute__((visibility("default")))
#else
#define MTDB_API
#endif

/* To C++ a value that is none of an enum's names is undefined, unless its type is fixed: functions
 * look at what callers give, and refuse it. */
#ifdef __cplusplus
#define MTDB_INT : int
#else
#define MTDB_INT
#endif

/* Sets up a struct that begins with struct_bytes. */
#define MTDB_INIT(object) \
  (memset(&(object), 0, sizeof(object)), (void)((object).struct_bytes = sizeof(object)))

/* 1xx the caller, 2xx bytes, 3xx the system. */
typedef enum mtdb_code MTDB_INT {
  MTDB_OK = 0,
  MTDB_INVALID_ARGUMENT = 100,
  MTDB_NOT_FOUND = 101,
  MTDB_ALREADY_EXISTS = 102,
  MTDB_UNSUPPORTED = 103, /* also: another ABI version */
  MTDB_CANCELLED = 104,   /* a callback or mtdb_cancel said so */
  MTDB_BUDGET_EXCEEDED = 105,
  MTDB_BAD_INPUT = 200,
  MTDB_CORRUPT = 201,
  MTDB_IO_ERROR = 300,
  MTDB_NO_SPACE = 301, /* disk or memory */
  MTDB_BUSY = 302,
  MTDB_NOT_YET = 303 /* what is needed is on its way: ask again. Stores answer at once. */
} mtdb_code;

/* One line: what is wrong, where, and what to do. A longer message is cut off. Room for a text,
 * which needs no setting up. */
typedef struct mtdb_error {
  char message[1024];
} mtdb_error;

typedef struct mtdb_database mtdb_database; /* a store file */
typedef struct mtdb_texts mtdb_texts;       /* a list of texts */
typedef struct mtdb_json mtdb_json;         /* a text of JSON */
typedef struct mtdb_object mtdb_object;     /* a surface, with a cache of decoded clusters */
typedef struct mtdb_query mtdb_query;       /* where, how accurate, how many */
typedef struct mtdb_cut mtdb_cut;           /* the answer */
typedef struct mtdb_control mtdb_control;   /* stops a query, watches its progress */

MTDB_API uint32_t mtdb_get_abi_version(void); /* MTDB_ABI_VERSION of the library */
MTDB_API const char* mtdb_get_version(void);  /* "0.1.0" */
/* A path, a URL or a text with some, as messages of the library show it: without passwords and
 * signatures. `shown` has room for `size` bytes and ends with 0; what does not fit is left out. */
MTDB_API mtdb_code mtdb_hide_secrets(const char* text, char* shown, size_t size, mtdb_error* error);

/* Databases. */

typedef struct mtdb_open_options {
  size_t struct_bytes;
  /* Of a URL: what comes of the file is kept in this folder, and need not come again; databases and
   * processes may share it. NULL: nowhere */
  const char* cache_directory;
  uint64_t cache_directory_bytes; /* at most so much lies there; 0: 4 GiB */
} mtdb_open_options;
MTDB_API mtdb_code mtdb_open_abi(uint32_t abi_version, const char* path,
                                 const mtdb_open_options* options, mtdb_database** database,
                                 mtdb_error* error);
/* Opens a store, a packed file or its URL for reading. */
#define mtdb_open(path, options, database, error) \
  mtdb_open_abi(MTDB_ABI_VERSION, (path), (options), (database), (error))
MTDB_API void mtdb_free_database(mtdb_database* database);

MTDB_API mtdb_code mtdb_list_objects(mtdb_database* database, mtdb_texts** names,
                                     mtdb_error* error);
MTDB_API size_t mtdb_count_texts(const mtdb_texts* texts);
/* NULL beyond the last. Lives as long as `texts`. */
MTDB_API const char* mtdb_get_text(const mtdb_texts* texts, size_t i);
MTDB_API void mtdb_free_texts(mtdb_texts* texts);

/* Objects. */

/* What the cache keeps between queries. Answers do not depend on it. */
typedef enum mtdb_form MTDB_INT {
  MTDB_FORM_EXPLICIT = 0, /* decoded clusters */
  MTDB_FORM_IMPLICIT = 1 /* clusters as in the store: some 15 times smaller, but every query decodes
                            what it needs. For many objects with few queries each. */
} mtdb_form;
typedef struct mtdb_object_options {
  size_t struct_bytes;
  uint64_t cache_bytes; /* of decoded clusters, those in use included; 0: 256 MiB */
  uint32_t threads;     /* that read and decode for one query; 0: as many as the machine has */
  mtdb_form form;
} mtdb_object_options;
/* `name` may be NULL: the store's only object. More than 1024 threads, and an unknown form, are
 * MTDB_INVALID_ARGUMENT. */
MTDB_API mtdb_code mtdb_open_object(mtdb_database* database, const char* name,
                                    const mtdb_object_options* options, mtdb_object** object,
                                    mtdb_error* error);
MTDB_API void mtdb_free_object(mtdb_object* object);
/* Lives as long as `object`. */
MTDB_API const char* mtdb_get_object_name(const mtdb_object* object);

typedef struct mtdb_info {
  size_t struct_bytes;
  uint64_t vertices; /* at full resolution */
  uint64_t triangles;
  uint64_t root_triangles; /* of the coarsest mesh */
  uint64_t clusters;
  double bounds_min[3];
  double bounds_max[3];
  double rounding_error; /* no vertex of the input is farther than this from its stored position */
  double error_max;      /* of the coarsest mesh */
  uint32_t attributes;   /* scalars of a vertex beside its position */
  uint32_t row_bytes;    /* of all of them */
} mtdb_info;
MTDB_API mtdb_code mtdb_get_object_info(const mtdb_object* object, mtdb_info* info,
                                        mtdb_error* error);

/* Takes bytes, and returns 0; anything else stops. */
typedef int (*mtdb_receive)(void* user, const unsigned char* bytes, size_t size);
/* Hands out the image file of a page of the object's texture, as it came, in parts; nothing when
 * the store has none. The pages' names, types and sizes are in the JSON of the object ("texture").
 * MTDB_NOT_FOUND: no such page. The bytes are checked at their end: they count when the call
 * succeeds. */
MTDB_API mtdb_code mtdb_read_page(const mtdb_object* object, uint32_t page, mtdb_receive receive,
                                  void* user, mtdb_error* error);

typedef enum mtdb_scalar MTDB_INT {
  MTDB_INT8 = 0,
  MTDB_UINT8 = 1,
  MTDB_INT16 = 2,
  MTDB_UINT16 = 3,
  MTDB_INT32 = 4,
  MTDB_UINT32 = 5,
  MTDB_FLOAT32 = 6,
  MTDB_FLOAT64 = 7
} mtdb_scalar;
typedef struct mtdb_attribute {
  size_t struct_bytes;
  const char* name; /* as in PLY: "red", "nx"; lives as long as the object */
  mtdb_scalar type;
  uint32_t offset; /* bytes from the start of a row; not aligned */
} mtdb_attribute;
MTDB_API mtdb_code mtdb_get_object_attribute(const mtdb_object* object, uint32_t i,
                                             mtdb_attribute* attribute, mtdb_error* error);

/* All that is known of the object: what `mtdb info --json` prints, with its digest, grid, rounds
 * and what its input had. */
MTDB_API mtdb_code mtdb_get_object_json(const mtdb_object* object, mtdb_json** json,
                                        mtdb_error* error);
/* Lives as long as `json`. */
MTDB_API const char* mtdb_get_json_text(const mtdb_json* json);
MTDB_API void mtdb_free_json(mtdb_json* json);

typedef enum mtdb_verify_level MTDB_INT {
  MTDB_VERIFY_FAST = 0,  /* every page of the file, every checksum of the object */
  MTDB_VERIFY_FULL = 1,  /* also decodes every cluster and compares it with the index */
  MTDB_VERIFY_GLOBAL = 2 /* also the full resolution: digest, border, Euler characteristic */
} mtdb_verify_level;
/* Looks for damage. `failures` has a line for each thing that is wrong; free it by mtdb_free_texts.
 * When mtdb_count_texts of it is 0, nothing is wrong. Damage is no error of this call; when an
 * object is so damaged that it cannot be opened, mtdb_open_object has said so. Reads the whole
 * file; safe beside queries. `control` (NULL: none) stops it: MTDB_CANCELLED. */
MTDB_API mtdb_code mtdb_verify(mtdb_object* object, mtdb_verify_level level,
                               const mtdb_control* control, mtdb_texts** failures,
                               mtdb_error* error);

/* Queries. */

/* What `json` asks for: where, how accurate and how much, by any region, threshold and budget of
 * docs/query.md; NULL or "{}": everything at full resolution. Relative errors are fractions of the
 * diagonal of `object`. Errors: MTDB_INVALID_ARGUMENT, whose message begins with the place in the
 * text. A query does not change: to ask for something else, make another; that takes some
 * microseconds.
 *
 * With "available_only" mtdb_select never waits for clusters. The answer is the least cut through
 * those that are in memory, with the error bound that it has; when some are missing,
 * mtdb_stats.limit is MTDB_LIMIT_MISSING, and they come meanwhile: ask again. MTDB_NOT_YET while
 * the coarsest mesh is on its way. What the cut uses stays in memory until mtdb_free_cut. */
MTDB_API mtdb_code mtdb_create_query(const mtdb_object* object, const char* json,
                                     mtdb_query** query, mtdb_error* error);
MTDB_API void mtdb_free_query(mtdb_query* query);

/* Controls. One serves one call that takes a control; that of mtdb_select serves its cut as well.
 * NULL in place of one: none. */

MTDB_API mtdb_code mtdb_create_control(mtdb_control** control, mtdb_error* error);
MTDB_API void mtdb_free_control(mtdb_control* control);
/* From any thread. Calls that got this control return MTDB_CANCELLED within some milliseconds, and
 * so do all later ones; of its cut, mtdb_copy_cut, mtdb_emit_cut and what else takes the mesh. A
 * callback is not interrupted. */
MTDB_API void mtdb_cancel(mtdb_control* control);

/* So far; the numbers only grow. */
typedef struct mtdb_progress {
  size_t struct_bytes;
  uint64_t clusters_loaded;
  uint64_t nodes_applied;
  uint64_t triangles_emitted;
  int cancelled; /* not 0: mtdb_cancel was called */
} mtdb_progress;
MTDB_API mtdb_code mtdb_get_progress(const mtdb_control* control, mtdb_progress* progress,
                                     mtdb_error* error);

/* Answers. */

/* What ended the refinement. */
typedef enum mtdb_limit MTDB_INT {
  MTDB_LIMIT_ACCURACY = 0, /* what was asked for is reached, except for the shortfall */
  MTDB_LIMIT_TRIANGLES = 1,
  MTDB_LIMIT_BYTES = 2,
  MTDB_LIMIT_TIME = 3,
  MTDB_LIMIT_MISSING = 4 /* clusters that are not in memory */
} mtdb_limit;
/* An answer's shortfall is where it is farther from the input than its query asks: vertices were
 * rounded by more when the object was ingested, or a budget ended the refinement. */
typedef struct mtdb_stats {
  size_t struct_bytes;
  uint64_t vertices;
  uint64_t triangles;
  double error_bound; /* in the region, no point of the mesh is farther than this from the input,
                         and no point of the input farther from the mesh */
  mtdb_limit limit;
  uint32_t row_bytes;        /* of this cut's rows: mtdb_info.row_bytes and its normals */
  uint64_t active_triangles; /* within their bound of the region */
  uint64_t nodes_applied;
  uint64_t nodes_visited;   /* of all clusters that the search looked into */
  uint64_t nodes_forced;    /* applied only because others need them as ancestors */
  uint64_t clusters_read;   /* from the file */
  uint64_t clusters_cached; /* were decoded already */
  uint64_t clusters_used;   /* have an applied node */
  uint64_t clusters_total;  /* of the object */
  uint64_t bytes_read;
  double select_seconds;          /* without load_seconds */
  double load_seconds;            /* of the calling thread: reading, decoding, waiting */
  double read_seconds;            /* of all threads that worked for the query */
  double decode_seconds;          /* of these threads, too */
  double emit_seconds;            /* so far; with the callbacks' time, without load_seconds */
  uint64_t shortfall_triangles;   /* 0: there is no shortfall, and the rest means nothing */
  double shortfall_excess;        /* the largest of (bound - error that was asked for there) */
  double shortfall_bounds_min[3]; /* around these triangles */
  double shortfall_bounds_max[3];
} mtdb_stats;

/* Finds the smallest mesh that satisfies the query; `query` NULL: everything. */
MTDB_API mtdb_code mtdb_select(mtdb_object* object, const mtdb_query* query,
                               const mtdb_control* control, mtdb_cut** cut, mtdb_error* error);
MTDB_API void mtdb_free_cut(mtdb_cut* cut);
MTDB_API mtdb_code mtdb_get_cut_stats(const mtdb_cut* cut, mtdb_stats* stats, mtdb_error* error);

/* The caller's arrays; a NULL is not filled. A capacity smaller than the cut's count
 * (mtdb_get_cut_stats) is MTDB_BUDGET_EXCEEDED, and nothing is written. */
typedef struct mtdb_arrays {
  size_t struct_bytes;
  uint64_t vertex_capacity;
  uint64_t triangle_capacity;
  double* positions;      /* x y z of each vertex */
  float* positions_float; /* x y z less origin */
  double origin[3];       /* what keeps georeferenced positions exact as float */
  uint32_t* indices;      /* three of each triangle, counter-clockwise from outside */
  unsigned char* rows;    /* mtdb_stats.row_bytes of each vertex */
} mtdb_arrays;
/* Arrays may be partly filled when clusters cannot be read. */
MTDB_API mtdb_code mtdb_copy_cut(mtdb_cut* cut, const mtdb_arrays* arrays, mtdb_error* error);

/* Callbacks for a mesh of any size, in blocks: begin, then all vertices, then all triangles.
 * Pointers that a callback gets are valid during the call. When a callback returns anything but 0,
 * the emission ends with MTDB_CANCELLED. A NULL is not called. */
typedef struct mtdb_sink {
  size_t struct_bytes;
  void* user; /* the first argument of each */
  int (*begin)(void* user, uint64_t vertices, uint64_t triangles);
  int (*vertices)(void* user, const double* positions, const unsigned char* rows, size_t count);
  int (*triangles)(void* user, const uint64_t* indices, size_t count);
} mtdb_sink;
MTDB_API mtdb_code mtdb_emit_cut(mtdb_cut* cut, const mtdb_sink* sink, mtdb_error* error);

/* Meshes in memory that the library owns: what a cut, a client (mtdb_follow.h) or a file has. They
 * do not change: many threads may use one. */
typedef struct mtdb_mesh mtdb_mesh;

#define MTDB_NO_PAGE 0xffffffffu /* of a triangle without an image */

typedef struct mtdb_mesh_view {
  size_t struct_bytes;
  uint64_t vertices;
  uint64_t triangles;
  const double* positions;      /* vertices * 3: x y z; NULL when the mesh has floats */
  const float* positions_float; /* x y z less origin; NULL when the mesh has doubles */
  double origin[3];
  const uint32_t* indices;   /* triangles * 3, counter-clockwise from outside */
  const unsigned char* rows; /* vertices * row_bytes: attributes; NULL when row_bytes is 0 */
  uint32_t row_bytes;
  uint32_t attributes; /* how many: mtdb_get_mesh_attribute */
  /* Of textured objects; NULL of others, and of meshes of files: where corners of triangles lie in
   * an image, triangles * 6: u and v of each, in the order of indices. u goes to the right and v
   * up, from 0 to 1 across the image; values beyond repeat it */
  const float* corners;
  const uint32_t* pages; /* likewise triangles: which image (mtdb_read_page), or MTDB_NO_PAGE */
} mtdb_mesh_view;
/* Takes the cut's mesh into memory: 24 bytes a vertex and its row, 12 a triangle, 28 more where it
 * has a texture. With an `origin`
 * positions are floats less that origin, 12 bytes a vertex; NULL: doubles. MTDB_INVALID_ARGUMENT
 * when there are more than 2^32 vertices. */
MTDB_API mtdb_code mtdb_get_cut_mesh(mtdb_cut* cut, const double* origin, mtdb_mesh** mesh,
                                     mtdb_error* error);
MTDB_API void mtdb_free_mesh(mtdb_mesh* mesh);
/* Pointers live as long as `mesh`. */
MTDB_API mtdb_code mtdb_view_mesh(const mtdb_mesh* mesh, mtdb_mesh_view* view, mtdb_error* error);
MTDB_API mtdb_code mtdb_get_mesh_attribute(const mtdb_mesh* mesh, uint32_t i,
                                           mtdb_attribute* attribute, mtdb_error* error);

/* Mesh files: PLY, OBJ, STL, OFF, glTF, Draco, by the suffix of `path`. */
MTDB_API mtdb_code mtdb_read_mesh(const char* path, mtdb_mesh** mesh, mtdb_error* error);
typedef struct mtdb_file_options {
  size_t struct_bytes;
  int normals;          /* not 0: .off has the normals, too, which many programs do not read */
  int double_positions; /* not 0: .ply has positions of float64, also where float32 is enough; other
                           formats of float32 refuse it */
} mtdb_file_options;
/* The file appears when it is complete. `json` (may be NULL): what the file has of the mesh:
 * "positions", "origin", "node_origin", "not_written" and "notes" of docs/json.md, and "rounding":
 * how far the format's float32 moved a vertex at most. */
MTDB_API mtdb_code mtdb_write_mesh(const mtdb_mesh* mesh, const char* path,
                                   const mtdb_file_options* options, mtdb_json** json,
                                   mtdb_error* error);
/* Writes the cut's mesh without holding it in memory. A terrain's z becomes y in .glb, which is up
 * there. */
MTDB_API mtdb_code mtdb_write_cut(mtdb_cut* cut, const char* path, const mtdb_file_options* options,
                                  mtdb_json** json, mtdb_error* error);

/* Probes: of a surface here, of a terrain's heights in mtdb_terrain.h. */

typedef struct mtdb_probe_options {
  size_t struct_bytes;
  double error; /* the largest that is good enough, of heights in units of height; 0: full
                   resolution */
  const mtdb_control* control; /* cancels */
} mtdb_probe_options;
typedef struct mtdb_hit {
  size_t struct_bytes;
  int found; /* 0: nothing within the limit, and the rest means nothing */
  int front; /* not 0: the probe comes from outside */
  double point[3];
  double distance;    /* of the point from that of the probe, or from the ray's origin */
  double parameter;   /* ray: the t of origin + t * direction; closest point: 0 */
  double triangle[9]; /* corners of the triangle that was met */
  double error_bound;
  double excess; /* error_bound less options.error when rounding at ingest makes that impossible;
                    else 0 */
} mtdb_hit;
/* Nothing farther than `limit`; it may be INFINITY. */
MTDB_API mtdb_code mtdb_find_closest_point(mtdb_object* object, const double point[3], double limit,
                                           const mtdb_probe_options* options, mtdb_hit* hit,
                                           mtdb_error* error);
/* The first hit at 0 <= t <= limit; it may be INFINITY. */
MTDB_API mtdb_code mtdb_cast_ray(mtdb_object* object, const double origin[3],
                                 const double direction[3], double limit,
                                 const mtdb_probe_options* options, mtdb_hit* hit,
                                 mtdb_error* error);

/* Comparisons. */

/* Whose points ask how far the other object is. */
typedef enum mtdb_asks MTDB_INT { MTDB_ASKS_BOTH = 0, MTDB_ASKS_A = 1, MTDB_ASKS_B = 2 } mtdb_asks;
typedef struct mtdb_compare_options {
  size_t struct_bytes;
  int has_tolerance; /* not 0: is each point of one object within `tolerance` of the other one? */
  double tolerance;
  double width; /* the interval of the largest distance becomes so narrow; 0: without a tolerance
                   1/10,000 of the diagonal */
  double reach; /* what is farther away is missing, and how far is not looked for; 0: infinite */
  int has_max_milliseconds;
  double max_milliseconds;
  const mtdb_query* query; /* its region says which points ask; NULL: all */
  const double* transform; /* 16 numbers, row by row: maps B into A's coordinates; NULL: none */
  mtdb_asks asks;          /* whose points ask */
  int as_stored;           /* not 0: what is stored is compared, not the inputs before rounding */
  uint32_t threads;        /* 0: as many as the machine has */
  const mtdb_control* control; /* cancels */
} mtdb_compare_options;
/* How far two objects are apart, and where, with a proof. `json`: what docs/json.md says of
 * mtdb/diff/1, without "seconds". `options` may be NULL. MTDB_INVALID_ARGUMENT for numbers that
 * mean nothing, and for terrains whose places and heights are in different units. */
MTDB_API mtdb_code mtdb_compare(mtdb_object* a, mtdb_object* b, const mtdb_compare_options* options,
                                mtdb_json** json, mtdb_error* error);

/* NOLINTEND(readability-identifier-naming) */

#ifdef __cplusplus
}
#endif

#endif
