// SPDX-License-Identifier: Apache-2.0
// Ways through other programs: the Python package, whose arrays come back as bytes; and a shell,
// which has the mesh written into a pipe.
#include <cstring>
#include <filesystem>

#include "tests/everything/ways.h"

namespace mtdb::everything {

namespace {

constexpr const char* kScript = R"(
import json, sys, mtdb, numpy
store, name, implicit, query, out = sys.argv[1:]
with open(query) as file:
    text = file.read()
with mtdb.open(store) as database:
    mesh = database.open_object(name, threads=2, implicit=implicit == "1").extract(text)
with open(out, "wb") as file:
    file.write(mesh.vertices.tobytes())
    file.write(mesh.faces.tobytes())
    if len(mesh.vertices) and mesh.attributes:
        file.write(numpy.hstack([
            numpy.ascontiguousarray(a).view(numpy.uint8).reshape(len(a), -1)
            for a in mesh.attributes.values()]).tobytes())
lacks = mesh.shortfall
print(json.dumps({"triangles": len(mesh.faces), "vertices": len(mesh.vertices),
                  "error_bound": mesh.error_bound, "limit": mesh.stats.limit,
                  "shortfall": None if lacks is None else {"excess": lacks.excess}}))
)";

std::string Quoted(const std::string& word) {
  std::string quoted = "'";
  for (const char c : word) quoted += c == '\'' ? std::string("'\\''") : std::string(1, c);
  return quoted + "'";
}

bool HasNumpy(World& world) {
  static const bool kHas = Run({"/usr/bin/python3", "-c", "import numpy"}, world.scratch()).ok();
  return kHas;
}

}  // namespace

bool AskPython(const Asked& asked, Answer* answer) {
  World& world = *asked.world;
  // It takes a second, so not every time.
  if (!asked.step->Flag("python") || std::string(MTDB_PYTHON).empty() || !HasNumpy(world)) {
    return false;
  }
  const std::string query = NewFile(asked, "json"), out = NewFile(asked, "bin");
  WriteText(query, asked.question->text());
  RunOptions run;
  run.environment = {"MTDB_LIBRARY=" MTDB_LIBRARY, "PYTHONPATH=" MTDB_PYTHON,
                     "PYTHONDONTWRITEBYTECODE=1"};
  const Ran ran =
      world.Checked(Run({"/usr/bin/python3", "-c", kScript, world.Store(asked.store).path,
                         asked.name, asked.question->implicit ? "1" : "0", query, out},
                        world.scratch(), run),
                    "python3");
  if (!ran.ok()) {
    answer->refused = ran.err.substr(ran.err.find_last_of('\n', ran.err.size() - 2) + 1);
    return true;
  }
  ReadAnswerJson(ran.out, answer);
  if (!answer->refused.empty()) return true;
  const auto json = nlohmann::json::parse(ran.out);
  const std::string bytes = ReadText(out);
  std::filesystem::remove(out);
  const size_t vertices = json.at("vertices"), triangles = json.at("triangles");
  AttributeLayout& layout = answer->mesh.header.attributes;
  layout = asked.object->layout;
  if (asked.question->normals) {
    for (const char* name : {"nx", "ny", "nz"}) {
      layout.attributes.push_back({name, ScalarType::kFloat32});
    }
  }
  const size_t rows = vertices * sizeof(Vec3d) + triangles * 3 * sizeof(int32_t);
  if (bytes.size() != rows + vertices * layout.row_bytes()) {
    answer->refused = "arrays of " + std::to_string(bytes.size()) + " bytes";
    return true;
  }
  answer->mesh.positions.resize(vertices);
  for (size_t v = 0; v < vertices; ++v) {
    std::memcpy(&answer->mesh.positions[v], bytes.data() + v * sizeof(Vec3d), sizeof(Vec3d));
  }
  for (size_t t = 0; t < triangles; ++t) {
    int32_t corners[3];
    std::memcpy(corners, bytes.data() + vertices * sizeof(Vec3d) + t * sizeof(corners),
                sizeof(corners));
    answer->mesh.triangles.push_back({static_cast<VertexIndex>(corners[0]),
                                      static_cast<VertexIndex>(corners[1]),
                                      static_cast<VertexIndex>(corners[2])});
  }
  const ByteSpan row_bytes = AsBytes(bytes).subspan(rows);
  answer->mesh.rows.assign(row_bytes.begin(), row_bytes.end());
  answer->has_rows = true;
  answer->exact = true;
  return true;
}

bool AskPipe(const Asked& asked, Answer* answer) {
  World& world = *asked.world;
  const std::string format = asked.step->Text("output", "ply");
  const std::string link = NewFile(asked, format), out = NewFile(asked, format);
  const std::string query = NewFile(asked, "json"), said = NewFile(asked, "said");
  const std::string code = NewFile(asked, "code");
  WriteText(query, asked.question->text());
  std::filesystem::create_symlink("/dev/fd/3", link);
  const std::string line = "{ " + Quoted(world.options().mtdb) + " extract " +
                           Quoted(world.Store(asked.store).path) + " " + Quoted(link) + " --name " +
                           Quoted(asked.name) + " --query " + query + " --json" +
                           (asked.question->implicit ? " --implicit" : "") + " 3>&1 >" + said +
                           "; echo $? >" + code + "; } | cat >" + out;
  const Ran ran = world.Checked(Run({"/bin/sh", "-c", line}, world.scratch()), "mtdb | cat");
  const bool ok = ran.ok() && ReadText(code) == "0\n";
  if (ok) ReadAnswerJson(ReadText(said), answer);
  if (!ok) answer->refused = ran.err;
  if (!std::filesystem::is_symlink(link)) world.Fault("pipe: a link is replaced", link);
  for (const std::string& file : {link, query, said, code}) std::filesystem::remove(file);
  // A format that goes back to its beginning says so.
  if (ran.err.find("which a pipe cannot") != std::string::npos) return false;
  if (answer->refused.empty()) ReadAnswerFile(out, answer);
  return true;
}

}  // namespace mtdb::everything
