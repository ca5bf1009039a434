// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cerrno>
#include <cstdio>
#include <memory>
#include <optional>
#include <system_error>

#include "codecs/mesh_file/mesh_file.h"
#include "store/files/guarded_file.h"
#include "tools/cli/options.h"
#include "tools/cli/verbs.h"
#include "tools/cli/verbs/follow_path.h"
#include "tools/client/client.h"
#include "tools/client/shortfall_json.h"
#include "tools/request/read_file.h"
#include "tools/request/report_json.h"

namespace mtdb {

namespace {

struct FollowArguments {
  std::string url;
  std::string path;    // a file of keyframes
  std::string output;  // a pattern of mesh files; empty: none
  std::string csv;     // empty: none
  std::string name;
  uint32_t remembered_vertices = 65536;
  double timeout_seconds = 600;
  double reconnect_seconds = 0;
  bool json = false;
};
using Count = unsigned long long;

Result<Json::Array> ReadPath(const std::string& path) {
  MTDB_ASSIGN_OR_RETURN(const std::string text, ReadFile(path));
  Result<Json::Array> queries = ParseFollowPath(text);
  if (!queries.ok()) return InvalidArgument(path + ": " + queries.status().message());
  return queries;
}

// One row a step, each written at once.
class CsvFile {
 public:
  ~CsvFile() {
    if (file_ != nullptr) std::fclose(file_);
  }
  Status Open(const std::string& path) {
    path_ = path;
    MTDB_RETURN_IF_ERROR(CheckReplaceable(path));
    file_ = std::fopen(path.c_str(), "w");
    if (file_ == nullptr) return Failure();
    return Check(
        std::fputs("step,query,bytes,messages,first_ms,done_ms,server_ms,triangles,"
                   "vertices,insertions,removals,error_bound,limit\n",
                   file_));
  }
  // What opening the session brought.
  Status AddStart(const RemoteSession& session, double milliseconds) {
    if (file_ == nullptr) return Status::Ok();
    return Check(std::fprintf(file_, "0,,%llu,1,,%.3f,,%u,%u,,,,\n", Count{session.start_bytes()},
                              milliseconds, session.mesh().triangle_count(),
                              session.mesh().vertex_count()));
  }
  Status Add(size_t step, const RemoteUpdate& u) {
    if (file_ == nullptr) return Status::Ok();
    return Check(std::fprintf(
        file_, "%zu,%llu,%llu,%llu,%.3f,%.3f,%.3f,%llu,%llu,%llu,%llu,%.9g,%s\n", step, Count{u.id},
        Count{u.bytes}, Count{u.messages}, u.first_ms, u.done_ms, u.server_ms, Count{u.triangles},
        Count{u.vertices}, Count{u.insertions}, Count{u.removals}, u.error_bound, u.limit.c_str()));
  }

 private:
  Status Check(int result) {
    return result >= 0 && std::fflush(file_) == 0 ? Status::Ok() : Failure();
  }
  Status Failure() const {
    return IoError(path_ + ": cannot be written: " + std::generic_category().message(errno));
  }
  std::string path_;
  std::FILE* file_ = nullptr;
};

Json StepJson(size_t step, const RemoteUpdate& u) {
  return {{"step", step},
          {"bytes", u.bytes},
          {"messages", u.messages},
          {"first_ms", u.first_ms},
          {"done_ms", u.done_ms},
          {"server_ms", u.server_ms},
          {"triangles", u.triangles},
          {"vertices", u.vertices},
          {"insertions", u.insertions},
          {"removals", u.removals},
          {"error_bound", u.error_bound},
          {"shortfall", ShortfallJson(u.shortfall)},
          {"limit", u.limit},
          {"restarted", u.restarted}};
}

void PrintSummary(const RemoteSession& session, const std::vector<RemoteUpdate>& updates) {
  std::vector<double> times;
  uint64_t bytes = 0, changes = 0, restarts = 0;
  for (const RemoteUpdate& u : updates) {
    times.push_back(u.done_ms);
    bytes += u.bytes;
    changes += u.insertions + u.removals;
    restarts += u.restarted ? 1 : 0;
  }
  const RemoteUpdate& last = updates.back();
  std::sort(times.begin(), times.end());
  std::printf("%s: %zu steps\n", session.object().c_str(), updates.size());
  std::printf("  base mesh: %.1f KB; updates: %.1f KB, %llu vertices in or out\n",
              static_cast<double>(session.start_bytes()) / 1e3, static_cast<double>(bytes) / 1e3,
              Count{changes});
  std::printf("  a step takes %.1f ms (median), %.1f ms at most\n", times[times.size() / 2],
              times.back());
  if (restarts > 0) {
    std::printf("  the connection was lost and replaced %llu times\n", Count{restarts});
  }
  std::printf("  last mesh: %llu triangles, %llu vertices, error at most %.6g\n",
              Count{last.triangles}, Count{last.vertices}, last.error_bound);
  std::fputs(ShortfallText(last.shortfall, last.limit).c_str(), stdout);
}

// What the file's numbers move, as an answer in a file counts it: the mesh may fall short of the
// error that was asked for by that alone.
void AddRounding(const Json& query, double rounding, const ClientMesh& mesh, RemoteUpdate* update) {
  update->error_bound += rounding;
  Shortfall& shortfall = update->shortfall;
  if (!(rounding > 0) || update->superseded) return;
  const Json& threshold = query["threshold"];
  if (shortfall.any()) {
    shortfall.excess += rounding;
  } else if (threshold.is_number() && threshold.number() >= 0 &&
             update->error_bound > threshold.number()) {
    shortfall.triangles = update->active_triangles;
    shortfall.excess = update->error_bound - threshold.number();
    for (uint32_t v = 0; v < mesh.vertex_slots(); ++v) {
      if (mesh.has_vertex(v)) shortfall.bounds.Add(mesh.options().grid.Position(mesh.position(v)));
    }
  }
}

Status Follow(const FollowArguments& arguments) {
  MTDB_ASSIGN_OR_RETURN(const Json::Array queries, ReadPath(arguments.path));
  CsvFile csv;
  if (!arguments.csv.empty()) MTDB_RETURN_IF_ERROR(csv.Open(arguments.csv));
  RemoteSessionOptions options;
  options.name = arguments.name;
  options.remembered_vertices = arguments.remembered_vertices;
  options.timeout_seconds = arguments.timeout_seconds;
  options.reconnect_seconds = arguments.reconnect_seconds;
  const auto begin = std::chrono::steady_clock::now();
  MTDB_ASSIGN_OR_RETURN(const std::unique_ptr<RemoteSession> session,
                        RemoteSession::Open(arguments.url, options));
  const std::chrono::duration<double, std::milli> opened = std::chrono::steady_clock::now() - begin;
  MTDB_RETURN_IF_ERROR(csv.AddStart(*session, opened.count()));
  std::vector<RemoteUpdate> updates;
  Json steps = Json::Array();
  for (const Json& query : queries) {
    const size_t step = updates.size() + 1;
    Result<RemoteUpdate> update = session->Update(query.Text());
    if (!update.ok()) {
      return {update.status().code(),
              "step " + std::to_string(step) + ": " + update.status().message()};
    }
    if (!arguments.output.empty()) {
      MTDB_ASSIGN_OR_RETURN(const std::string file, StepFile(arguments.output, step));
      MTDB_ASSIGN_OR_RETURN(const std::unique_ptr<MeshFileWriter> writer,
                            CreateMeshFileWriter(file));
      MTDB_RETURN_IF_ERROR(session->SendMesh(*writer));
      AddRounding(query, writer->rounding(), session->mesh(), &*update);
    }
    MTDB_RETURN_IF_ERROR(csv.Add(step, *update));
    if (arguments.json) steps.push_back(StepJson(step, *update));
    updates.push_back(*std::move(update));
  }
  if (arguments.json) {
    PrintAnswer("follow", {{"url", arguments.url},
                           {"object", session->object()},
                           {"start_bytes", session->start_bytes()},
                           {"start_ms", opened.count()},
                           {"steps", steps}});
  } else {
    PrintSummary(*session, updates);
  }
  session->Close();
  return Status::Ok();
}

RunVerb AddFollow(VerbOptions* verb) {
  const auto a = std::make_shared<FollowArguments>();
  AddUrl(verb, &a->url);
  verb->Add("--path", a->path,
            "what to ask for: a JSON object a line, a query of its own or a keyframe; "
            "required")
      .Required()
      .Form("FILE");
  verb->Add("--output", a->output,
            "write the mesh of each step; %d or %03d stands for the step: step-%03d.ply")
      .Form("PATTERN")
      .Check([](const std::string& text) {
        const Status status = StepFile(text, 0).status();
        return status.ok() ? WrittenMeshFormatOf(text).status().message() : status.message();
      });
  verb->Add("--csv", a->csv, "write a table of bytes, milliseconds and triangles, a row a step")
      .Form("FILE");
  AddName(verb, &a->name);
  verb->Add("--remembered-vertices", a->remembered_vertices,
            "remember N removed vertices, so that they need not come again")
      .Form("N")
      .Between(0, 1 << 24);
  AddTimeout(verb, &a->timeout_seconds);
  AddParsed(verb, "--reconnect", "SECONDS", &a->reconnect_seconds, ParseSeconds,
            "when the connection is lost, try so long to get another, and go on from the base mesh")
      .Default("0");
  AddJson(verb, &a->json);
  return [a](Invocation&) { return Follow(*a); };
}

}  // namespace

const Verb kFollowVerb{
    "follow", "drive a session of a server (mtdb serve) along a path of queries",
    "A line of FILE is a query (docs/query.md), or has short forms of one:\n"
    "  {\"camera\": {\"eye\": [0, -9, 4], \"target\": [0, 0, 3]}, \"pixels\": 1}\n"
    "  {\"camera\": {\"eye\": [9, 0, 4], \"target\": [0, 0, 3]}, \"pixels\": 1, "
    "\"steps\": 30}\n"
    "  {\"box\": {\"min\": [0, 0, 0], \"max\": [1, 1, 1]}, \"error\": 0.01}\n"
    "With \"steps\" so many queries lead from the line before to this one, along a "
    "straight line.\n"
    "Example: mtdb follow http://localhost:8080/objects/statue --path flight.jsonl "
    "--output step-%03d.ply --csv flight.csv\n"
    "More: docs/protocol.md",
    AddFollow};

}  // namespace mtdb
