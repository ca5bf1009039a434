/* SPDX-License-Identifier: Apache-2.0 */
/* mtdb for C, and for every language that can call C: libmtdb.so. This header reads stores;
 * mtdb_write.h makes them, mtdb_follow.h keeps meshes that follow a query, mtdb_show.h draws and
 * serves.
 *
 *   mtdb_error error;
 *   mtdb_database* database = NULL;
 *   if (mtdb_open("scans.mtdb", &database, &error) != MTDB_OK) puts(error.message);
 *
 * tools/example_c.c is a whole program. Rules that hold everywhere:
 *
 * - A call that can fail returns an mtdb_code and takes an mtdb_error, which may be NULL. Results
 *   are written on MTDB_OK only. Nothing is printed, and there is no global state.
 * - Each kind of handle has its mtdb_free_...; freeing NULL does nothing. A handle keeps what it
 *   needs of the handle that it was made from: handles may be freed in any order.
 * - A NULL where something is needed, and numbers that make no sense, are MTDB_INVALID_ARGUMENT.
 * - Many threads at once may use a database, an object or a control; one thread at a time may use a
 *   query or a cut.
 * - Lengths are in the object's units; texts are UTF-8 with a 0 at the end.
 * - Structs that begin with struct_bytes may grow: a program sets them up by MTDB_INIT (or sets
 *   struct_bytes to their size, and all else to 0), and goes on working with later libraries. In
 *   options, 0 and NULL stand for the default; a NULL in place of the whole struct for all
 * defaults.
 *
 * The interface grows by new functions and structs; a change of an existing one raises
 * MTDB_ABI_VERSION. mtdb_query_set_json takes new kinds of regions and thresholds as they come.
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

/* One line: what is wrong, where, and what to do. A longer message is cut off. */
typedef struct mtdb_error {
  char message[1024];
} mtdb_error;

typedef struct mtdb_database mtdb_database; /* a store file */
typedef struct mtdb_names mtdb_names;       /* a list of texts */
typedef struct mtdb_object mtdb_object;     /* a surface, with a cache of decoded clusters */
typedef struct mtdb_query mtdb_query;       /* where, how accurate, how many */
typedef struct mtdb_cut mtdb_cut;           /* the answer */
typedef struct mtdb_control mtdb_control;   /* stops a query, watches its progress */

MTDB_API uint32_t mtdb_abi_version(void); /* MTDB_ABI_VERSION of the library */
MTDB_API const char* mtdb_version(void);  /* "0.1.0" */
/* A path, a URL or a text with some, as messages of the library show it: without passwords and
 * signatures. `shown` has room for `size` bytes and ends with 0; what does not fit is left out. */
MTDB_API mtdb_code mtdb_without_secrets(const char* text, char* shown, size_t size,
                                        mtdb_error* error);

/* Databases. */

MTDB_API mtdb_code mtdb_open_abi(uint32_t abi_version, const char* path, mtdb_database** database,
                                 mtdb_error* error);
/* Opens a store for reading. */
#define mtdb_open(path, database, error) \
  mtdb_open_abi(MTDB_ABI_VERSION, (path), (database), (error))

typedef struct mtdb_open_options {
  size_t struct_bytes;
  /* Of a URL: what comes of the file is kept in this folder, and need not come again; databases and
   * processes may share it. NULL: nowhere */
  const char* cache_directory;
  uint64_t cache_directory_bytes; /* at most so much lies there; 0: 4 GiB */
} mtdb_open_options;
MTDB_API mtdb_code mtdb_open_with_abi(uint32_t abi_version, const char* path,
                                      const mtdb_open_options* options, mtdb_database** database,
                                      mtdb_error* error);
/* Opens a store, a packed file or its URL for reading; `options` NULL: all 0. */
#define mtdb_open_with(path, options, database, error) \
  mtdb_open_with_abi(MTDB_ABI_VERSION, (path), (options), (database), (error))
MTDB_API void mtdb_free_database(mtdb_database* database);

MTDB_API mtdb_code mtdb_list_objects(mtdb_database* database, mtdb_names** names,
                                     mtdb_error* error);
MTDB_API size_t mtdb_names_count(const mtdb_names* names);
/* NULL beyond the last. Lives as long as `names`. */
MTDB_API const char* mtdb_names_at(const mtdb_names* names, size_t i);
MTDB_API void mtdb_free_names(mtdb_names* names);

/* Objects. */

/* `name` may be NULL: the store's only object. `cache_bytes` of decoded clusters; 0: 256 MiB. */
MTDB_API mtdb_code mtdb_open_object(mtdb_database* database, const char* name, size_t cache_bytes,
                                    mtdb_object** object, mtdb_error* error);
/* What the cache keeps between queries. Answers do not depend on it. */
typedef enum mtdb_form MTDB_INT {
  MTDB_FORM_EXPLICIT = 0, /* decoded clusters */
  MTDB_FORM_IMPLICIT = 1 /* clusters as in the store: some 15 times smaller, but every query decodes
                            what it needs. For many objects with few queries each. */
} mtdb_form;
typedef struct mtdb_object_options {
  size_t cache_bytes; /* of decoded clusters, those in use included; 0: 256 MiB */
  uint32_t threads;   /* that read and decode for one query; 0: as many as the machine has */
  uint32_t form;      /* an mtdb_form */
} mtdb_object_options;
/* Likewise; `options` NULL: all 0. More than 1024 threads, and an unknown form, are
 * MTDB_INVALID_ARGUMENT. */
MTDB_API mtdb_code mtdb_open_object_with(mtdb_database* database, const char* name,
                                         const mtdb_object_options* options, mtdb_object** object,
                                         mtdb_error* error);
MTDB_API void mtdb_free_object(mtdb_object* object);
/* Lives as long as `object`. */
MTDB_API const char* mtdb_object_name(const mtdb_object* object);

typedef struct mtdb_info {
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
MTDB_API mtdb_code mtdb_object_info(const mtdb_object* object, mtdb_info* info, mtdb_error* error);

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
  const char* name; /* as in PLY: "red", "nx"; lives as long as the object */
  mtdb_scalar type;
  uint32_t offset; /* bytes from the start of a row; not aligned */
} mtdb_attribute;
MTDB_API mtdb_code mtdb_object_attribute(const mtdb_object* object, uint32_t i,
                                         mtdb_attribute* attribute, mtdb_error* error);

/* All that is known of the object, as one text of JSON: what `mtdb info --json` prints, with its
 * digest, grid, rounds and what its input had. */
MTDB_API mtdb_code mtdb_object_json(const mtdb_object* object, mtdb_names** json,
                                    mtdb_error* error);

typedef enum mtdb_verify_level MTDB_INT {
  MTDB_VERIFY_FAST = 0,  /* every page of the file, every checksum of the object */
  MTDB_VERIFY_FULL = 1,  /* also decodes every cluster and compares it with the index */
  MTDB_VERIFY_GLOBAL = 2 /* also the full resolution: digest, border, Euler characteristic */
} mtdb_verify_level;
/* Looks for damage. `failures` has a line for each thing that is wrong; free it by mtdb_free_names.
 * When mtdb_names_count of it is 0, nothing is wrong. Damage is no error of this call; when an
 * object is so damaged that it cannot be opened, mtdb_open_object has said so. Reads the whole
 * file; safe beside queries. `control` (NULL: none) stops it: MTDB_CANCELLED. */
MTDB_API mtdb_code mtdb_verify(mtdb_object* object, mtdb_verify_level level,
                               const mtdb_control* control, mtdb_names** failures,
                               mtdb_error* error);

/* Queries. A new one asks for everything at full resolution. */

MTDB_API mtdb_code mtdb_create_query(mtdb_query** query, mtdb_error* error);
MTDB_API void mtdb_free_query(mtdb_query* query);

/* Regions: where accuracy is wanted; elsewhere the mesh is as coarse as it can be. Several regions
 * together are what lies in at least one of them. A query without regions wants accuracy
 * everywhere. */
MTDB_API mtdb_code mtdb_query_add_box(mtdb_query* query, const double min[3], const double max[3],
                                      mtdb_error* error);
MTDB_API mtdb_code mtdb_query_add_sphere(mtdb_query* query, const double centre[3], double radius,
                                         mtdb_error* error);

/* Thresholds: the largest error that is permitted. Of several, the smallest holds, place by place.
 * A query without thresholds asks for full resolution. */
MTDB_API mtdb_code mtdb_query_add_constant_error(mtdb_query* query, double largest,
                                                 mtdb_error* error);
MTDB_API mtdb_code mtdb_query_add_full_resolution(mtdb_query* query, mtdb_error* error);
MTDB_API mtdb_code mtdb_query_add_coarsest(mtdb_query* query, mtdb_error* error);
/* base + slope * (distance from `point`). */
MTDB_API mtdb_code mtdb_query_add_linear_error(mtdb_query* query, const double point[3],
                                               double base, double slope, mtdb_error* error);

/* Replaces all that the query asked for before by what `json` asks for: any region, threshold and
 * budget of docs/query.md. Functions above may then add further regions and thresholds to those of
 * the JSON. Relative errors are fractions of the diagonal of `object`. The control stays. On an
 * error the query stays as it was, and the message begins with the place in the text. */
MTDB_API mtdb_code mtdb_query_set_json(mtdb_query* query, const mtdb_object* object,
                                       const char* json, mtdb_error* error);

/* Budgets; 0: no limit. The largest errors are refined first, until the threshold is met or a limit
 * is reached (mtdb_details.limit). The coarsest mesh is returned in any case. */

/* At most so many triangles, before clipping. */
MTDB_API mtdb_code mtdb_query_set_max_triangles(mtdb_query* query, uint64_t count,
                                                mtdb_error* error);
/* At most so many bytes of clusters read from the store. */
MTDB_API mtdb_code mtdb_query_set_max_bytes(mtdb_query* query, uint64_t bytes, mtdb_error* error);
/* Wall time of the selection. Negative or NaN: MTDB_INVALID_ARGUMENT. */
MTDB_API mtdb_code mtdb_query_set_max_milliseconds(mtdb_query* query, double milliseconds,
                                                   mtdb_error* error);

/* Not 0: leaves out the triangles that do not meet the region. */
MTDB_API mtdb_code mtdb_query_set_clip(mtdb_query* query, int clip, mtdb_error* error);
/* Not 0: each vertex has the mesh's unit normal, three floats nx ny nz, at the end of its row. */
MTDB_API mtdb_code mtdb_query_set_normals(mtdb_query* query, int normals, mtdb_error* error);
/* Not 0: mtdb_select never waits for clusters. The answer is the least cut through those that are
 * in memory, with the error bound that it has; when some are missing, mtdb_details.limit is
 * MTDB_LIMIT_MISSING, and they come meanwhile: ask again. MTDB_NOT_YET while the coarsest mesh is
 * on its way. Not with max_bytes (MTDB_INVALID_ARGUMENT). What the cut uses stays in memory until
 * mtdb_free_cut. */
MTDB_API mtdb_code mtdb_query_set_available_only(mtdb_query* query, int available_only,
                                                 mtdb_error* error);

/* Controls. One serves one query and its cut, or one mtdb_verify. */

MTDB_API mtdb_code mtdb_create_control(mtdb_control** control, mtdb_error* error);
MTDB_API void mtdb_free_control(mtdb_control* control);
/* NULL: none. */
MTDB_API mtdb_code mtdb_query_set_control(mtdb_query* query, const mtdb_control* control,
                                          mtdb_error* error);
/* From any thread. mtdb_select, mtdb_cut_copy, mtdb_cut_emit and mtdb_verify with this control
 * return MTDB_CANCELLED within some milliseconds, and so do all later calls. A callback is not
 * interrupted. */
MTDB_API void mtdb_cancel(mtdb_control* control);

/* So far; the numbers only grow. */
typedef struct mtdb_progress {
  uint64_t clusters_loaded;
  uint64_t nodes_applied;
  uint64_t triangles_emitted;
  int cancelled; /* not 0: mtdb_cancel was called */
} mtdb_progress;
MTDB_API mtdb_code mtdb_control_progress(const mtdb_control* control, mtdb_progress* progress,
                                         mtdb_error* error);

/* Answers. */

typedef struct mtdb_stats {
  uint64_t vertices;
  uint64_t triangles;
  uint64_t nodes_applied;
  uint64_t clusters_read; /* from the file; others were in the cache */
  uint64_t bytes_read;
  double error_bound; /* in the region, no point of the mesh is farther than this from the input,
                         and no point of the input farther from the mesh */
} mtdb_stats;

/* Finds the smallest mesh that satisfies the query; `query` may be NULL: everything. */
MTDB_API mtdb_code mtdb_select(mtdb_object* object, const mtdb_query* query, mtdb_cut** cut,
                               mtdb_error* error);
MTDB_API void mtdb_free_cut(mtdb_cut* cut);
MTDB_API mtdb_code mtdb_cut_stats(const mtdb_cut* cut, mtdb_stats* stats, mtdb_error* error);

/* What ended the refinement. */
typedef enum mtdb_limit MTDB_INT {
  MTDB_LIMIT_THRESHOLD = 0, /* the accuracy that was asked for, except for the shortfall */
  MTDB_LIMIT_TRIANGLES = 1,
  MTDB_LIMIT_BYTES = 2,
  MTDB_LIMIT_TIME = 3,
  MTDB_LIMIT_MISSING = 4 /* clusters that are not in memory */
} mtdb_limit;
/* Where an answer is farther from the input than its query asks: vertices were rounded by more
 * when the object was ingested, or a budget ended the refinement. */
typedef struct mtdb_shortfall {
  uint64_t triangles;   /* 0: nowhere, and the rest means nothing */
  double excess;        /* the largest of (bound - error that was asked for there) */
  double bounds_min[3]; /* around these triangles */
  double bounds_max[3];
} mtdb_shortfall;
/* What mtdb_stats does not say. */
typedef struct mtdb_details {
  mtdb_limit limit;
  uint32_t row_bytes;        /* of this cut's rows: mtdb_info.row_bytes and its normals */
  uint64_t active_triangles; /* within their bound of the region */
  uint64_t nodes_visited;    /* of all clusters that the search looked into */
  uint64_t nodes_forced;     /* applied only because others need them as ancestors */
  uint64_t clusters_cached;  /* were decoded already */
  uint64_t clusters_used;    /* have an applied node */
  uint64_t clusters_total;   /* of the object */
  double select_seconds;     /* without load_seconds */
  double load_seconds;       /* of the calling thread: reading, decoding, waiting */
  double read_seconds;       /* of all threads that worked for the query */
  double decode_seconds;     /* likewise */
  double emit_seconds;       /* so far; with the callbacks' time, without load_seconds */
  mtdb_shortfall shortfall;
} mtdb_details;
MTDB_API mtdb_code mtdb_cut_details(const mtdb_cut* cut, mtdb_details* details, mtdb_error* error);

/* The caller's arrays; a NULL is not filled. A capacity smaller than the cut's count
 * (mtdb_cut_stats) is MTDB_BUDGET_EXCEEDED, and nothing is written. */
typedef struct mtdb_arrays {
  uint64_t vertex_capacity;
  uint64_t triangle_capacity;
  double* positions;      /* x y z of each vertex */
  float* positions_float; /* likewise, less origin */
  double origin[3];       /* what keeps georeferenced positions exact as float */
  uint32_t* indices;      /* three of each triangle, counter-clockwise from outside */
  unsigned char* rows;    /* mtdb_details.row_bytes of each vertex */
} mtdb_arrays;
/* Arrays may be partly filled when clusters cannot be read. */
MTDB_API mtdb_code mtdb_cut_copy(mtdb_cut* cut, const mtdb_arrays* arrays, mtdb_error* error);

/* Callbacks for a mesh of any size, in blocks: begin, then all vertices, then all triangles.
 * Pointers that a callback gets are valid during the call. When a callback returns anything but 0,
 * the emission ends with MTDB_CANCELLED. A NULL is not called. */
typedef struct mtdb_sink {
  void* user; /* the first argument of each */
  int (*begin)(void* user, uint64_t vertices, uint64_t triangles);
  int (*vertices)(void* user, const double* positions, const unsigned char* rows, size_t count);
  int (*triangles)(void* user, const uint64_t* indices, size_t count);
} mtdb_sink;
MTDB_API mtdb_code mtdb_cut_emit(mtdb_cut* cut, const mtdb_sink* sink, mtdb_error* error);

/* Meshes in memory that the library owns: what a cut, a client (mtdb_follow.h) or a file has. They
 * do not change: many threads may use one. */
typedef struct mtdb_mesh mtdb_mesh;

typedef struct mtdb_mesh_view {
  size_t struct_bytes;
  uint64_t vertices;
  uint64_t triangles;
  const double* positions;      /* vertices * 3: x y z; NULL when the mesh has floats */
  const float* positions_float; /* likewise, less origin; NULL when the mesh has doubles */
  double origin[3];
  const uint32_t* indices;   /* triangles * 3, counter-clockwise from outside */
  const unsigned char* rows; /* vertices * row_bytes: attributes; NULL when row_bytes is 0 */
  uint32_t row_bytes;
  uint32_t attributes; /* how many: mtdb_mesh_attribute */
} mtdb_mesh_view;
/* Takes the cut's mesh into memory: 24 bytes a vertex and its row, 12 a triangle. With an `origin`
 * positions are floats less that origin, 12 bytes a vertex; NULL: doubles. MTDB_INVALID_ARGUMENT
 * when there are more than 2^32 vertices. */
MTDB_API mtdb_code mtdb_cut_mesh(mtdb_cut* cut, const double* origin, mtdb_mesh** mesh,
                                 mtdb_error* error);
MTDB_API void mtdb_free_mesh(mtdb_mesh* mesh);
/* Pointers live as long as `mesh`. */
MTDB_API mtdb_code mtdb_mesh_look(const mtdb_mesh* mesh, mtdb_mesh_view* view, mtdb_error* error);
MTDB_API mtdb_code mtdb_mesh_attribute(const mtdb_mesh* mesh, uint32_t i, mtdb_attribute* attribute,
                                       mtdb_error* error);

/* Mesh files: PLY, OBJ, STL, OFF, glTF, Draco, by the suffix of `path`. */
MTDB_API mtdb_code mtdb_read_mesh(const char* path, mtdb_mesh** mesh, mtdb_error* error);
/* The file appears when it is complete. `rounding` (may be NULL): how far the format's float32
 * moved a vertex at most. */
MTDB_API mtdb_code mtdb_write_mesh(const mtdb_mesh* mesh, const char* path, double* rounding,
                                   mtdb_error* error);
/* Likewise, without holding the mesh in memory. A terrain's z becomes y in .glb, which is up there.
 */
MTDB_API mtdb_code mtdb_cut_write(mtdb_cut* cut, const char* path, double* rounding,
                                  mtdb_error* error);
typedef struct mtdb_file_options {
  size_t struct_bytes;
  int normals;          /* not 0: .off has the normals, too, which many programs do not read */
  int double_positions; /* not 0: .ply has positions of float64, also where float32 is enough; other
                           formats of float32 refuse it */
} mtdb_file_options;
/* The same two with options (NULL: none). `json` (may be NULL): one text of JSON, what the file has
 * of the mesh: "positions", "origin", "node_origin", "not_written" and "notes" of docs/json.md, and
 * "rounding". */
MTDB_API mtdb_code mtdb_write_mesh_as(const mtdb_mesh* mesh, const char* path,
                                      const mtdb_file_options* options, mtdb_names** json,
                                      mtdb_error* error);
MTDB_API mtdb_code mtdb_cut_write_as(mtdb_cut* cut, const char* path,
                                     const mtdb_file_options* options, mtdb_names** json,
                                     mtdb_error* error);

/* Probes. `largest_error` negative: at full resolution. */

typedef struct mtdb_hit {
  int found; /* 0: nothing within the limit, and the rest means nothing */
  int front; /* not 0: the probe comes from outside */
  double point[3];
  double distance;    /* closest point: in units; ray: the parameter t of origin + t * direction */
  double triangle[9]; /* corners of the triangle that was met */
  double error_bound;
  double excess; /* error_bound less largest_error when rounding at ingest makes largest_error
                    impossible; else 0 */
} mtdb_hit;
/* Nothing farther than max_distance; it may be INFINITY. */
MTDB_API mtdb_code mtdb_closest_point(mtdb_object* object, const double point[3],
                                      double largest_error, double max_distance, mtdb_hit* hit,
                                      mtdb_error* error);
/* The first hit at 0 <= t <= max_parameter; it may be INFINITY. */
MTDB_API mtdb_code mtdb_cast_ray(mtdb_object* object, const double origin[3],
                                 const double direction[3], double largest_error,
                                 double max_parameter, mtdb_hit* hit, mtdb_error* error);

/* NOLINTEND(readability-identifier-naming) */

#ifdef __cplusplus
}
#endif

#endif
