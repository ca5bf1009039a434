/* SPDX-License-Identifier: Apache-2.0 */
/* mtdb for C: makes stores, and changes what is in them. Begin with mtdb.h, whose rules hold here.
 *
 *   mtdb_input input;
 *   MTDB_INIT(input);
 *   input.vertices = n;  input.positions = positions;
 *   input.triangles = m; input.indices = indices;
 *   mtdb_open_writable("scans.mtdb", &database, &error);
 *   mtdb_ingest_arrays(database, "statue", &input, NULL, NULL, &error);
 *
 * tools/example_write.c is a whole program. A reader sees an object whole or not at all; what a
 * process that dies has begun is removed by the next writer. Several threads may use one writable
 * database; ingests of different names run side by side.
 */
#ifndef MTDB_TOOLS_C_MTDB_WRITE_H
#define MTDB_TOOLS_C_MTDB_WRITE_H

#include "tools/c/mtdb.h"

#ifdef __cplusplus
extern "C" {
#endif

/* NOLINTBEGIN(readability-identifier-naming) */

/* For writing, and for reading too; the file is made when it is not there. */
MTDB_API mtdb_code mtdb_open_writable_abi(uint32_t abi_version, const char* path,
                                          mtdb_database** database, mtdb_error* error);
#define mtdb_open_writable(path, database, error) \
  mtdb_open_writable_abi(MTDB_ABI_VERSION, (path), (database), (error))

/* Watches work that takes long, and stops it: MTDB_CANCELLED. NULL: nobody looks. */
typedef struct mtdb_watch {
  size_t struct_bytes;
  void* user; /* the first argument of `progress` */
  /* Called now and then, on the calling thread; anything but 0 stops. `stage` says what is done now
   * ("read", "round 1", "copy"); `overall` is 0..1, or negative where nobody knows. NULL: none. */
  int (*progress)(void* user, const char* stage, double overall);
  const mtdb_control* control; /* mtdb_cancel of it stops; NULL: none */
} mtdb_watch;

/* Ingest. */

/* Rounds a float attribute to multiples of `step` > 0. */
typedef struct mtdb_attribute_step {
  size_t struct_bytes;
  const char* name;
  double step;
} mtdb_attribute_step;

typedef struct mtdb_ingest_options {
  size_t struct_bytes;
  int replace;   /* not 0: an object of that name gives way when the new one is complete */
  int lossless;  /* not 0: float32 positions bit for bit; no bits, no step */
  uint32_t bits; /* 1..24: positions on a grid of 2^bits cells along the longest side; 0: a grid
                    that suits the mesh */
  double step;   /* > 0: positions on multiples of it instead, in units of the input */
  int weld;      /* > 0: joins vertices that are at most weld_distance apart; 0: those of equal
                    positions and attributes where the mesh was cut along edges; < 0: none */
  double weld_distance;
  uint32_t normal_bits; /* 4..16: of nx ny nz the direction only; 0: lossless */
  const mtdb_attribute_step* attribute_steps;
  size_t attribute_step_count;
  uint32_t threads;      /* 0: as many as the machine has. The result does not depend on it */
  uint64_t memory_bytes; /* the most that the ingest takes, 256 MiB or more; 0: 1 GiB. The rest goes
                            to temporary files. The result does not depend on it */
  const char* tmp_directory; /* of temporary files; NULL: the store's folder */
  const char* journal_path;  /* the file by which an ingest that is killed can go on; NULL: none */
  int resume;                /* not 0: goes on with the journal, if there is one of this input */
  double height_step; /* rasters: heights are rounded to its multiples; 0: the step of the raster,
                         or one that suits it (mtdb_terrain.h). Rasters take no bits, step,
                         lossless, weld, orient, normal_bits and attribute_steps */
  int terrain;   /* not 0: the mesh is a height field, z above x and y, and becomes a terrain, with
                    vertical errors; MTDB_BAD_INPUT with the place where it is folded */
  uint32_t fill; /* rasters: closes holes of up to so many columns and rows; 0: none */
  uint64_t max_tmp_bytes; /* the most that temporary files, the copy of a compressed file and the
                             journal take on the disk, else MTDB_BUDGET_EXCEEDED; 0: no limit */
  double up[3]; /* what is up, of any length; 0 0 0: found from the shape (terrains: z). Who draws
                   the object goes by it */
  const char* units; /* of lengths: "um", "mm", "cm", "m", "km", "in" or "ft"; NULL: not said */
  int orient; /* not 0: turns triangles over where those of a sheet disagree about the outside, as
                 few as possible; a sheet hangs together across edges of two triangles. Not of
                 rasters */
} mtdb_ingest_options;

/* A mesh in the caller's arrays, which are read during the call. */
typedef struct mtdb_input {
  size_t struct_bytes;
  uint64_t vertices;
  uint64_t triangles;
  const double* positions;      /* x y z of each vertex; either this */
  const float* positions_float; /* or this */
  double origin[3];             /* is added to positions_float */
  const uint32_t* indices;      /* three of each triangle, counter-clockwise from outside; either */
  const uint64_t* indices_long; /* or this */
  const unsigned char* rows;    /* the attributes of each vertex, side by side without gaps */
  const mtdb_attribute* attributes; /* their names and types; offsets are not read */
  size_t attribute_count;
} mtdb_input;
/* Stores the mesh under `name`, at every level of detail. Errors: MTDB_BAD_INPUT (no triangles,
 * coordinates that are not finite, indices out of range), MTDB_ALREADY_EXISTS, MTDB_BUSY (somebody
 * is writing that name), MTDB_BUDGET_EXCEEDED (memory_bytes is too little; the message says how
 * much is needed), MTDB_NO_SPACE, MTDB_IO_ERROR, MTDB_CANCELLED. The store is unchanged then. */
MTDB_API mtdb_code mtdb_ingest_arrays(mtdb_database* database, const char* name,
                                      const mtdb_input* input, const mtdb_ingest_options* options,
                                      const mtdb_watch* watch, mtdb_error* error);

/* Out of core: a function of the caller gives the mesh, part after part. */
typedef struct mtdb_ingest mtdb_ingest; /* lives while `produce` runs */
typedef struct mtdb_source {
  size_t struct_bytes;
  void* user; /* the first argument of `produce` */
  /* Calls mtdb_ingest_part as often as it likes, on this thread, and returns 0; anything else gives
   * the ingest up: MTDB_CANCELLED. Called once. */
  int (*produce)(void* user, mtdb_ingest* ingest);
  const mtdb_attribute* attributes; /* as in mtdb_input */
  size_t attribute_count;
  int double_positions; /* not 0: some positions are no float32 values */
} mtdb_source;
MTDB_API mtdb_code mtdb_ingest_source(mtdb_database* database, const char* name,
                                      const mtdb_source* source, const mtdb_ingest_options* options,
                                      const mtdb_watch* watch, mtdb_error* error);
/* The next vertices and triangles; `part` has either or both. Its attributes are those of the
 * mtdb_source: its attribute list is not read. Vertices are numbered from 0 in the order in which
 * they come; a triangle may name one that comes later. After an error `produce` should return; the
 * ingest ends with that error. */
MTDB_API mtdb_code mtdb_ingest_part(mtdb_ingest* ingest, const mtdb_input* part, mtdb_error* error);

/* A mesh file, as `mtdb ingest` reads it, compressed by gzip or not; or a raster
 * (mtdb_ingest_rasters). */
MTDB_API mtdb_code mtdb_ingest_file(mtdb_database* database, const char* name, const char* path,
                                    const mtdb_ingest_options* options, const mtdb_watch* watch,
                                    mtdb_error* error);

/* A mesh of the caller's arrays, which it copies: to draw it, to write it to a file. Positions stay
 * what they are, double or float. */
MTDB_API mtdb_code mtdb_create_mesh(const mtdb_input* input, mtdb_mesh** mesh, mtdb_error* error);

/* Objects of a store. */

/* Who has the object open reads on as long as it can: what is not read yet may be gone. */
MTDB_API mtdb_code mtdb_remove_object(mtdb_database* database, const char* name, mtdb_error* error);
MTDB_API mtdb_code mtdb_rename_object(mtdb_database* database, const char* name,
                                      const char* new_name, mtdb_error* error);
/* Copies an object of any store or packed file: the same bytes, checked on the way, the same
 * digest. `target`: writable, another store. */
MTDB_API mtdb_code mtdb_copy_object(mtdb_object* object, mtdb_database* target, const char* name,
                                    int replace, const mtdb_watch* watch, mtdb_error* error);

/* Whole stores. */

/* A new store at `path` with all objects as they are at one moment; it appears when it is complete.
 */
MTDB_API mtdb_code mtdb_copy_store(mtdb_database* database, const char* path,
                                   const mtdb_watch* watch, mtdb_error* error);
typedef struct mtdb_sizes {
  size_t struct_bytes;
  uint64_t bytes_before;
  uint64_t bytes_after;
  uint64_t first_bytes; /* mtdb_pack: that a first picture of the first object takes */
} mtdb_sizes;
/* Gives back the space that no object uses. Nobody may have the store open for writing, this
 * process included: MTDB_BUSY. Who reads goes on with the old file. `sizes` may be NULL. */
MTDB_API mtdb_code mtdb_compact_store(const char* path, const mtdb_watch* watch, mtdb_sizes* sizes,
                                      mtdb_error* error);
/* Writes a packed file: for any web server (docs/packed.md). `names`: which objects, in this order;
 * `count` 0: all. */
MTDB_API mtdb_code mtdb_pack(mtdb_database* database, const char* const* names, size_t count,
                             const char* path, const mtdb_watch* watch, mtdb_sizes* sizes,
                             mtdb_error* error);
/* Copies objects of a packed file into the store at `path`, which is made when it is not there:
 * the same bytes, the same digests. `names`: which objects; `count` 0: all. */
MTDB_API mtdb_code mtdb_unpack(mtdb_database* database, const char* const* names, size_t count,
                               const char* path, int replace, const mtdb_watch* watch,
                               mtdb_error* error);

/* NOLINTEND(readability-identifier-naming) */

#ifdef __cplusplus
}
#endif

#endif
