/* SPDX-License-Identifier: Apache-2.0 */
/* The mesh of the C tests of the C interface: a hilly square with colours, in arrays and in parts.
 */
#ifndef MTDB_TESTS_QUERY_C_API_MESH_H_
#define MTDB_TESTS_QUERY_C_API_MESH_H_

#include <math.h>
#include <stdint.h>
#include <string.h>

#include "tests/query/c_api_checks.h"
#include "tools/c/mtdb_write.h"

enum { kSide = 60, kVertices = kSide * kSide, kTriangles = 2 * (kSide - 1) * (kSide - 1) };

/* A hilly square with a colour and a float each vertex. */
static double positions[kVertices * 3];
static float floats[kVertices * 3];
static uint32_t indices[kTriangles * 3];
static uint64_t indices_long[kTriangles * 3];
typedef struct row {
  unsigned char colour[3];
  unsigned char heat[4];
} row;
static row rows[kVertices];
static const mtdb_attribute kAttributes[4] = {{sizeof(mtdb_attribute), "red", MTDB_UINT8, 0},
                                              {sizeof(mtdb_attribute), "green", MTDB_UINT8, 0},
                                              {sizeof(mtdb_attribute), "blue", MTDB_UINT8, 0},
                                              {sizeof(mtdb_attribute), "heat", MTDB_FLOAT32, 0}};

static void make_mesh(void) {
  int x, y, k = 0;
  for (y = 0; y < kSide; ++y) {
    for (x = 0; x < kSide; ++x) {
      const int v = y * kSide + x;
      const float heat = (float)x;
      positions[3 * v] = 0.25 * x;
      positions[3 * v + 1] = 0.25 * y;
      positions[3 * v + 2] = floor(64 * sin(0.2 * x) * cos(0.3 * y)) / 64;
      floats[3 * v] = (float)positions[3 * v];
      floats[3 * v + 1] = (float)positions[3 * v + 1];
      floats[3 * v + 2] = (float)positions[3 * v + 2];
      rows[v].colour[0] = (unsigned char)(4 * x);
      rows[v].colour[1] = (unsigned char)(4 * y);
      rows[v].colour[2] = 128;
      memcpy(rows[v].heat, &heat, sizeof(heat));
      if (x + 1 < kSide && y + 1 < kSide) {
        const uint32_t a = (uint32_t)v, b = a + 1, c = a + kSide, d = c + 1;
        const uint32_t both[6] = {a, b, d, a, d, c};
        memcpy(indices + k, both, sizeof(both));
        k += 6;
      }
    }
  }
  for (k = 0; k < kTriangles * 3; ++k) indices_long[k] = indices[k];
}

static mtdb_input whole(void) {
  mtdb_input input;
  MTDB_INIT(input);
  input.vertices = kVertices;
  input.triangles = kTriangles;
  input.positions = positions;
  input.indices = indices;
  input.rows = (const unsigned char*)rows;
  input.attributes = kAttributes;
  input.attribute_count = 4;
  return input;
}

/* The mesh in parts of 100 vertices and 77 triangles; triangles may come before their vertices. */
typedef struct producing {
  int stop_after; /* parts; 0: never */
  int bad;
} producing;
static int produce(void* user, mtdb_ingest* ingest) {
  const producing* how = (const producing*)user;
  uint64_t at;
  int parts = 0;
  for (at = 0; at < kTriangles; at += 77) {
    mtdb_input part;
    MTDB_INIT(part);
    part.triangles = kTriangles - at < 77 ? kTriangles - at : 77;
    part.indices_long = indices_long + 3 * at;
    if (how->bad && at > 0) part.indices = indices; /* both: wrong */
    if (at < kVertices && at / 77 * 100 < kVertices) {
      const uint64_t v = at / 77 * 100;
      part.vertices = kVertices - v < 100 ? kVertices - v : 100;
      part.positions_float = floats + 3 * v;
      part.rows = (const unsigned char*)(rows + v);
    }
    if (mtdb_ingest_part(ingest, &part, &error) != MTDB_OK) return 7;
    if (++parts == how->stop_after) return 1;
  }
  for (at = at / 77 * 100; at < kVertices; at += 100) {
    mtdb_input part;
    MTDB_INIT(part);
    part.vertices = kVertices - at < 100 ? kVertices - at : 100;
    part.positions_float = floats + 3 * at;
    part.rows = (const unsigned char*)(rows + at);
    if (mtdb_ingest_part(ingest, &part, &error) != MTDB_OK) return 7;
  }
  return 0;
}

#endif
