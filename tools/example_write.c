/* SPDX-License-Identifier: Apache-2.0 */
/* Makes a store from C: a hilly square from arrays in memory, with a progress line; then takes the
 * coarse whole of it, and draws it. example_write STORE PICTURE.png */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>

#include "tools/c/mtdb.h"
#include "tools/c/mtdb_show.h"
#include "tools/c/mtdb_write.h"

enum { kSide = 300, kWidth = 640, kHeight = 480 };

static mtdb_error error;

/* Ends the program with the error's text. */
static void check(mtdb_code code) {
  if (code == MTDB_OK) return;
  fprintf(stderr, "%s\n", error.message);
  exit(1);
}

static int report(void* user, const char* stage, double overall) {
  (void)user;
  printf("\r%-10s %3.0f %%", stage, 100 * overall);
  return 0; /* anything else would stop */
}

static void fill(double* positions, uint32_t* indices) {
  uint32_t x, y;
  for (y = 0; y < kSide; ++y) {
    for (x = 0; x < kSide; ++x) {
      *positions++ = x;
      *positions++ = y;
      *positions++ = 12 * sin(0.04 * x) * cos(0.05 * y);
      if (x + 1 < kSide && y + 1 < kSide) {
        const uint32_t a = y * kSide + x, b = a + kSide;
        *indices++ = a, *indices++ = a + 1, *indices++ = b + 1;
        *indices++ = a, *indices++ = b + 1, *indices++ = b;
      }
    }
  }
}

int main(int argc, char** argv) {
  mtdb_database* database = NULL;
  mtdb_object* object = NULL;
  mtdb_query* query = NULL;
  mtdb_cut* cut = NULL;
  mtdb_mesh* mesh = NULL;
  mtdb_input input;
  mtdb_ingest_options options;
  mtdb_watch watch;
  mtdb_mesh_view view;
  mtdb_render_options render;
  double* positions = malloc(sizeof(double) * 3 * kSide * kSide);
  uint32_t* indices = malloc(sizeof(uint32_t) * 6 * (kSide - 1) * (kSide - 1));
  unsigned char* rgb = malloc((size_t)3 * kWidth * kHeight);

  if (argc != 3 || positions == NULL || indices == NULL || rgb == NULL) return 2;
  fill(positions, indices);
  MTDB_INIT(input);
  input.vertices = kSide * kSide;
  input.triangles = 2 * (kSide - 1) * (kSide - 1);
  input.positions = positions;
  input.indices = indices;
  MTDB_INIT(options);
  options.replace = 1;
  MTDB_INIT(watch);
  watch.progress = report;
  check(mtdb_open_writable(argv[1], &database, &error));
  check(mtdb_ingest_arrays(database, "hills", &input, &options, &watch, &error));

  check(mtdb_open_object(database, "hills", NULL, &object, &error));
  check(mtdb_create_query(object, "{\"threshold\": 0.5}", &query, &error));
  check(mtdb_select(object, query, NULL, &cut, &error));
  check(mtdb_get_cut_mesh(cut, NULL, &mesh, &error));
  MTDB_INIT(view);
  check(mtdb_view_mesh(mesh, &view, &error));
  printf("\nwithin 0.5: %llu of %llu triangles\n", (unsigned long long)view.triangles,
         (unsigned long long)input.triangles);

  MTDB_INIT(render);
  render.width = kWidth;
  render.height = kHeight;
  render.wireframe = 1;
  check(mtdb_render(mesh, &render, rgb, (size_t)3 * kWidth * kHeight, &error));
  check(mtdb_write_png(argv[2], rgb, kWidth, kHeight, 3, &error));

  mtdb_free_mesh(mesh);
  mtdb_free_cut(cut);
  mtdb_free_query(query);
  mtdb_free_object(object);
  mtdb_free_database(database);
  free(positions);
  free(indices);
  free(rgb);
  return 0;
}
