// SPDX-License-Identifier: Apache-2.0
#include "codecs/mesh_file/readers/mesh_format_table.h"
#include "codecs/mesh_file/readers/readers.h"

namespace mtdb::internal {

namespace {

// A reader and a writer as the table wants them, for those that need less.
template <auto kRead>
Status Read(const InputFile& file, const MeshFileStart&, MeshSink& sink, MeshReadReport* report) {
  return kRead(file, sink, report);
}
template <auto kCreate>
Result<std::unique_ptr<MeshWriter>> Create(const std::string& path, const MeshWriteOptions&) {
  return kCreate(path);
}
template <auto kCreate>
Result<std::unique_ptr<MeshWriter>> CreateWith(const std::string& path,
                                               const MeshWriteOptions& options) {
  return kCreate(path, options);
}

}  // namespace

std::vector<MeshFormatRow> OwnMeshFormats() {
  std::vector<MeshFormatRow> rows;
  rows.push_back({.format = {.name = "PLY", .suffixes = {"ply"}, .exact = true},
                  .recognise = RecognisePly,
                  .read = ReadPly,
                  .create_writer = CreateWith<CreatePlyWriter>});
  rows.push_back(
      {.format = {.name = "OBJ", .suffixes = {"obj"}, .content_type = "model/obj", .exact = true},
       .recognise = RecogniseObj,
       .read = ReadObj,
       .create_writer = Create<CreateObjWriter>});
  rows.push_back({.format = {.name = "STL", .suffixes = {"stl"}, .content_type = "model/stl"},
                  .recognise = RecogniseStl,
                  .read = ReadStl,
                  .create_writer = Create<CreateStlWriter>});
  rows.push_back({.format = {.name = "OFF", .suffixes = {"off"}, .exact = true},
                  .recognise = RecogniseOff,
                  .read = ReadOff,
                  .create_writer = CreateWith<CreateOffWriter>});
  rows.push_back(
      {.format = {.name = "glTF", .suffixes = {"glb"}, .content_type = "model/gltf-binary"},
       .recognise = RecogniseGltf,
       .read = ReadGltf,
       .create_writer = CreateWith<CreateGltfWriter>});
  rows.push_back({.format = {.name = "Draco", .suffixes = {"drc"}, .keeps_mesh = true},
                  .recognise = RecogniseDraco,
                  .read = Read<ReadDraco>,
                  .create_writer = CreateDracoWriter});
  rows.push_back(
      {.format = {.name = "glTF JSON", .suffixes = {"gltf"}, .content_type = "model/gltf+json"},
       .recognise = RecogniseGltfJson,
       .read = ReadGltf});
  return rows;
}

}  // namespace mtdb::internal
