// SPDX-License-Identifier: Apache-2.0
#include <chrono>
#include <memory>

#include "codecs/mesh_file/atomic_file.h"
#include "codecs/mesh_file/mesh_file.h"
#include "tools/cli/grouped.h"
#include "tools/cli/options.h"
#include "tools/cli/query_report.h"
#include "tools/cli/verbs.h"
#include "tools/client/client.h"
#include "tools/client/shortfall_json.h"
#include "tools/request/mesh_output.h"
#include "tools/request/report_json.h"

namespace mtdb {

namespace {

using Clock = std::chrono::steady_clock;

void PrintFetched(const QueryArguments& arguments, const Json& query, const FetchAnswer& a,
                  double seconds) {
  const bool missed = query.contains("region") && a.active_triangles == 0;
  Json unmet;
  const uint64_t* const most = query["max_triangles"].whole_number();
  if (most != nullptr && a.triangles > *most) {
    unmet = {
        {"max_triangles", *most}, {"least", a.triangles}, {"reason", "no coarser mesh is stored"}};
  }
  const MeshWriteReport file = ParseMeshFile(a.file);
  if (arguments.json) {
    Json json = {{"url", arguments.store},
                 {"path", a.path},
                 {"output", arguments.output},
                 {"triangles", a.triangles},
                 {"vertices", a.vertices},
                 {"active_triangles", a.active_triangles},
                 {"error_bound", a.error_bound},
                 {"shortfall", ShortfallJson(a.shortfall)},
                 {"region_missed", missed},
                 {"unmet_limit", unmet},
                 {"limit", a.limit},
                 {"clusters_read", a.clusters_read},
                 {"clusters_cached", a.clusters_cached},
                 {"clusters_total", a.clusters_total},
                 {"bytes_read", a.bytes_read},
                 {"bytes_received", a.bytes_received},
                 {"seconds", {{"total", seconds}}}};
    json.Update(MeshFileJson(file));
    PrintAnswer("fetch", json);
    return;
  }
  std::printf("%s: %s triangles, %s vertices, error at most %.6g\n", arguments.output.c_str(),
              Grouped(a.triangles).c_str(), Grouped(a.vertices).c_str(), a.error_bound);
  if (TellsShortfall(query, a.limit)) {
    std::fputs(ShortfallText(a.shortfall, a.limit).c_str(), stdout);
  }
  if (missed) {
    std::printf("  WARNING: nothing of the surface is in the region, so %s\n",
                a.triangles == 0 ? "the mesh is empty" : "the mesh is as coarse as it goes");
  }
  if (!unmet.is_null()) {
    std::printf("  WARNING: the limit of %s triangles cannot be kept: no coarser mesh is stored\n",
                Grouped(*most).c_str());
  }
  std::fputs(MeshFileText(file).c_str(), stdout);
  std::printf("  received %s in %.3g s\n", SizeText(a.bytes_received).c_str(), seconds);
  if (!arguments.verbose) return;
  std::printf(
      "  %s triangles are in the region or within their error of it; what ended the "
      "refinement: %s\n",
      Grouped(a.active_triangles).c_str(), a.limit.c_str());
  std::printf("  the server read %s of %s clusters (%s); %s were in its memory\n",
              Grouped(a.clusters_read).c_str(), Grouped(a.clusters_total).c_str(),
              SizeText(a.bytes_read).c_str(), Grouped(a.clusters_cached).c_str());
}

Status Fetch(const QueryArguments& arguments) {
  const Clock::time_point begin = Clock::now();
  MTDB_ASSIGN_OR_RETURN(const Json query, QueryOf(arguments.query, arguments.size));
  if (arguments.print_query) {
    PrintJson(query);
    return Status::Ok();
  }
  MTDB_ASSIGN_OR_RETURN(const MeshFormat format, WrittenMeshFormatOf(arguments.output));
  FetchOptions options;
  options.name = arguments.name;
  options.format = format.suffixes[0];
  options.double_positions = arguments.double_positions;
  options.timeout_seconds = arguments.timeout_seconds;
  std::unique_ptr<AtomicFile> output;
  const auto receive = [&](std::string_view piece) -> Status {
    if (output == nullptr) {
      MTDB_ASSIGN_OR_RETURN(output, AtomicFile::Create(arguments.output));
    }
    return output->Append(piece);
  };
  MTDB_ASSIGN_OR_RETURN(const FetchAnswer answer,
                        FetchMesh(arguments.store, query.Text(), options, receive));
  MTDB_RETURN_IF_ERROR(receive(""));
  MTDB_RETURN_IF_ERROR(output->Commit());
  PrintFetched(arguments, query, answer,
               std::chrono::duration<double>(Clock::now() - begin).count());
  return Status::Ok();
}

RunVerb AddFetch(VerbOptions* verb) {
  const auto a = std::make_shared<QueryArguments>();
  AddUrl(verb, &a->store);
  AddOutput(verb, &a->output);
  AddQueryOptions(verb, a.get(), false);
  AddTimeout(verb, &a->timeout_seconds);
  AddMeshOptions(verb, a.get());
  return [a](Invocation&) { return Fetch(*a); };
}

}  // namespace

const Verb kFetchVerb{
    "fetch", "extract from a server (mtdb serve)",
    "Example: mtdb fetch http://localhost:8080/objects/statue head.ply --error 0.5 "
    "--sphere 0,0,180,60\n"
    "More: docs/query.md, docs/protocol.md",
    AddFetch};

}  // namespace mtdb
