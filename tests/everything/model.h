// SPDX-License-Identifier: Apache-2.0
// The model: what stores must hold and what an object must be, by the definitions alone.
#pragma once

#include <map>
#include <memory>
#include <string>
#include <unordered_set>
#include <vector>

#include "store/object_record.h"
#include "tests/everything/input.h"

namespace mtdb::everything {

// An object that was ingested: its input, rounded as its options say.
//
// Parameters of a step: bits (16; 0: none are given), step: of the longest side instead, lossless;
// normals: bits; round: of float attributes, a step.
struct StoredObject {
  Truth truth;
  bool lossless = false;
  int bits = 16;    // 0: chosen by ingest
  double step = 0;  // above 0: model units, instead of bits
  int normal_bits = 0;
  double round = 0;

  // Known when the store has it (Settle).
  Grid grid;
  AttributeLayout layout;
  double displaced = 0;  // how far rounding moves a vertex, at most
  uint64_t root_triangles = 0;
  double diagonal = 0;
  std::unordered_set<std::string> vertices;  // VertexKey of each
  TriangleMesh mesh;                         // what the store has: the truth's, rounded

  // What the command line says of the options.
  std::vector<std::string> Options() const;
  // Why an ingest has to refuse this; empty when it must not.
  std::string Refusal() const;
};

StoredObject Planned(const Step& step, const Truth& truth);
// What is wrong with the record that the store has of it; takes over its grid and layout.
std::string Settle(const ObjectRecord& record, StoredObject* object);

// A vertex as bytes: its position, as doubles or rounded to float32, and `row_bytes` of its row.
std::string VertexKey(const TriangleMesh& mesh, VertexIndex v, bool as_float, size_t row_bytes);
// Each triangle as bytes, from its smallest corner on; sorted.
std::vector<std::string> TriangleKeys(const TriangleMesh& mesh, bool as_float, size_t row_bytes);

struct StoreModel {
  std::map<std::string, std::shared_ptr<StoredObject>> objects;  // by name
  bool exists = false;                                           // some ingest has made the file
};

}  // namespace mtdb::everything
