/* SPDX-License-Identifier: Apache-2.0 */
/* mtdb for C: draws meshes, and serves stores. Begin with mtdb.h, whose rules hold here. */
#ifndef MTDB_TOOLS_C_MTDB_SHOW_H
#define MTDB_TOOLS_C_MTDB_SHOW_H

#include "tools/c/mtdb.h"

#ifdef __cplusplus
extern "C" {
#endif

/* NOLINTBEGIN(readability-identifier-naming) */

/* What a picture's colours say. */
typedef enum mtdb_colour MTDB_INT {
  MTDB_COLOUR_VERTEX = 0, /* attributes red, green, blue of type uint8; clay where there are none */
  MTDB_COLOUR_NONE = 1,   /* clay */
  MTDB_COLOUR_NORMAL = 2, /* x, y, z from -1 to 1 as red, green, blue from 0 to 255 */
  MTDB_COLOUR_ATTRIBUTE = 3, /* `attribute`, through a colour map */
  MTDB_COLOUR_DISTANCE = 4,  /* of each point from `reference`, through the same map */
  MTDB_COLOUR_HEIGHT = 5     /* z as maps have it, from green to white */
} mtdb_colour;
typedef struct mtdb_render_options {
  size_t struct_bytes;
  uint32_t width; /* pixels, at most 16384; 0: 1200 and 900 */
  uint32_t height;
  int wireframe; /* not 0: edges are drawn */
  int smooth;    /* not 0: normals go smoothly over triangles, but for edges of some 50 degrees */
  int hillshade; /* not 0: lit as maps are, from the north-west of x and y */
  int draft;     /* not 0: light from the eye, without shadows, in an eighth of the time */
  int has_frame; /* not 0: this box fills the picture; else the mesh does */
  double frame_min[3];
  double frame_max[3];
  double view_direction[3]; /* from the eye to the mesh; 0: that of `view` */
  const char* view;         /* front, back, left, right, top, bottom, iso; NULL: auto */
  double up[3];             /* 0: found from the mesh; with a camera 0 0 1 */
  int has_camera;           /* not 0: what a camera sees instead */
  double eye[3];
  double target[3];
  double fov; /* vertical, degrees; 0: 45.8, of 0.8 radians */
  mtdb_colour colour;
  const char* attribute;      /* of MTDB_COLOUR_ATTRIBUTE */
  const mtdb_mesh* reference; /* of MTDB_COLOUR_DISTANCE */
  double height_scale;        /* of MTDB_COLOUR_HEIGHT: what z was multiplied by; 0: 1 */
  const char* height_units;   /* in its legend; NULL: none */
  int has_range; /* not 0: the values of the first and the last colour; else those found */
  double range[2];
  int no_legend; /* not 0: no legend of colours that stand for values */
  int scale_bar; /* not 0: a round length, at the depth of the middle */
  int has_background;
  unsigned char background[3]; /* red, green, blue; else a dark gradient */
  int transparent; /* not 0: no background, and 4 bytes a pixel: red, green, blue, alpha */
} mtdb_render_options;
/* Draws into `pixels`: rows from the top, width * height * 3 bytes (4, transparent), which the
 * caller owns. Uses all cores; some 150 bytes a triangle, also of the reference. */
MTDB_API mtdb_code mtdb_render(const mtdb_mesh* mesh, const mtdb_render_options* options,
                               unsigned char* pixels, size_t pixel_bytes, mtdb_error* error);
/* `channels`: 3, or 4 with alpha. */
MTDB_API mtdb_code mtdb_write_png(const char* path, const unsigned char* pixels, uint32_t width,
                                  uint32_t height, uint32_t channels, mtdb_error* error);

typedef struct mtdb_server mtdb_server;
typedef struct mtdb_serve_options {
  size_t struct_bytes;
  const char* address;         /* NULL: 127.0.0.1. Whoever can connect can read the whole store */
  uint32_t port;               /* 0: any free one */
  uint32_t threads;            /* queries at once; 0: as many as the machine has */
  uint64_t cache_bytes;        /* for each open object; 0: 256 MiB */
  uint64_t max_triangles;      /* of one mesh; 0: 20 million */
  const char* allowed_origin;  /* of web pages that may open sessions; "*": any; NULL: its own */
  const char* cache_directory; /* as in mtdb_open_options */
  uint64_t cache_directory_bytes; /* likewise */
} mtdb_serve_options;
/* Serves the store at `path` (docs/protocol.md) in threads of its own; returns when clients can
 * connect. Signals stay the program's. */
MTDB_API mtdb_code mtdb_serve(const char* path, const mtdb_serve_options* options,
                              mtdb_server** server, mtdb_error* error);
/* "http://127.0.0.1:8080"; lives as long as `server`. */
MTDB_API const char* mtdb_get_server_url(const mtdb_server* server);
/* Lets running requests finish for so long, cancels what is left, and waits for it. */
MTDB_API mtdb_code mtdb_stop_server(mtdb_server* server, double grace_seconds, mtdb_error* error);
/* Stops it at once when it is running. */
MTDB_API void mtdb_free_server(mtdb_server* server);

/* NOLINTEND(readability-identifier-naming) */

#ifdef __cplusplus
}
#endif

#endif
