// SPDX-License-Identifier: Apache-2.0
// Ways that lead past what is kept: a server's /packed, a folder of kept ranges that is harmed
// between two runs, JSON that waits for nothing, a cache that is too small, and its file on disk.
#include <algorithm>
#include <atomic>
#include <chrono>
#include <filesystem>
#include <memory>
#include <optional>
#include <sys/stat.h>
#include <thread>

#include "codecs/mesh_file/mesh_file.h"
#include "store/base/mesh_sink.h"
#include "tests/everything/ways.h"
#include "tests/support/file_server.h"

namespace mtdb::everything {

namespace fs = std::filesystem;

namespace {

// What may become of a folder of kept ranges. One of these, at a byte of the entry.
void Harm(const std::string& folder, const std::string& how, double where) {
  std::error_code error;
  std::vector<fs::path> entries;
  for (const auto& entry : fs::directory_iterator(folder, error)) entries.push_back(entry.path());
  for (const fs::path& path : entries) {
    std::string bytes = ReadText(path.string());
    const auto at = static_cast<size_t>(where * static_cast<double>(bytes.size()));
    if (how == "flip" && at < bytes.size()) bytes[at] = static_cast<char>(bytes[at] ^ 0x40);
    if (how == "cut") bytes.resize(at);
    if (how == "zero") std::fill(bytes.begin() + static_cast<ptrdiff_t>(at), bytes.end(), '\0');
    if (how == "flip" || how == "cut" || how == "zero") WriteText(path.string(), bytes);
    if (how == "gone" || how == "fifo" || how == "folder" || how == "link") fs::remove(path);
    if (how == "fifo") ::mkfifo(path.c_str(), 0600);
    if (how == "folder") fs::create_directory(path);
    if (how == "link") fs::create_symlink("/dev/zero", path);
  }
}

}  // namespace

bool AskServedPacked(const Asked& asked, Answer* answer) {
  FromPlace(asked, Serving(asked)->url() + ObjectPath(asked) + "/packed", {}, answer);
  return answer->refused.find("without libcurl") == std::string::npos;
}

bool AskKept(const Asked& asked, Answer* answer) {
  const std::string harm = asked.step->Text("kept");
  if (harm.empty()) return false;
  const std::string file = Packed(asked, answer);
  if (file.empty()) return true;
  const std::string bytes = ReadText(file);
  fs::remove(file);
  const double where = asked.step->Number("kept-at", 0.5);
  const auto damaged = static_cast<uint64_t>(where * static_cast<double>(bytes.size()));
  std::atomic<bool> lies{harm == "lies"};
  const mtdb::testing::FileServer server(
      bytes, [&](const mtdb::testing::FileRequest& request, mtdb::testing::FileReply* reply) {
        if (!lies || damaged < request.first) return;
        const uint64_t at = damaged - request.first;
        if (at < reply->body.size()) reply->body[at] = static_cast<char>(reply->body[at] ^ 0x40);
      });
  const std::string folder = asked.world->Folder("out/kept");
  const Arguments how{"--cache-directory", folder, "--cache-directory-bytes",
                      asked.step->Text("kept-size", "1G")};
  Answer first = *answer;
  FromPlace(asked, server.url(), how, &first);
  if (!first.refused.empty() && !lies) {
    *answer = std::move(first);
  } else {
    lies = false;
    Harm(folder, harm, where);
    // Beside another process that reads the same, by the same folder.
    const std::string output = NewFile(asked, "ply");
    Arguments other{asked.world->options().mtdb,
                    "extract",
                    server.url(),
                    output,
                    "--name",
                    asked.name,
                    "--full"};
    other.insert(other.end(), how.begin(), how.end());
    std::optional<Child> beside;
    if (asked.step->Flag("kept-twice")) beside.emplace(other, asked.world->scratch());
    FromPlace(asked, server.url(), how, answer);
    if (beside) {
      const Ran ran = asked.world->Checked(beside->Wait(), "mtdb extract");
      if (!ran.ok()) asked.world->ErrorFault("ask: url-kept: beside another one", ran.err);
      Answer all;
      TriangleMeshSink sink(&all.mesh);
      MeshReadReport report;
      if (ran.ok() && asked.object->mesh.triangles.size() > 0) {
        const Status read = ReadMeshFile(output, sink, &report);
        if (!read.ok() || all.mesh.triangles.size() != asked.object->mesh.triangles.size()) {
          asked.world->Fault("ask: url-kept: another mesh beside another one", read.message());
        }
      }
      fs::remove(output);
    }
  }
  fs::remove_all(folder);
  return answer->refused.find("without libcurl") == std::string::npos;
}

bool AskAvailableJson(const Asked& asked, Answer* answer) {
  if (asked.question->has_bytes || asked.question->has_time) return false;
  Json query = asked.question->json;
  query["available_only"] = true;
  const std::string target =
      ObjectPath(asked) + "/mesh?format=" + asked.step->Text("output", "ply");
  constexpr auto kMostTime = std::chrono::seconds(600);
  const auto until = std::chrono::steady_clock::now() + kMostTime;
  for (;;) {
    *answer = Answer();
    answer->way = "available-json";
    FromHttp(asked, "POST", target, query.dump(), answer);
    const bool not_yet = answer->refused.find("not_yet") != std::string::npos;
    if (!not_yet && answer->limit != "missing") return true;
    if (std::chrono::steady_clock::now() > until) break;
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }
  answer->refused = "a server that never waits never comes to its end";
  return true;
}

bool AskSmallCache(const Asked& asked, Answer* answer) {
  const std::string cache = asked.step->Text("cache");
  if (cache.empty()) return false;
  World& world = *asked.world;
  const std::string folder = world.Folder("out/spill"), harm = asked.step->Text("spill");
  fs::create_directories(folder);
  RunOptions run;
  run.environment = {"TMPDIR=" + (harm == "missing" ? folder + "/none" : folder)};
  if ((harm == "enospc" || harm == "eio" || harm == "short") && !world.options().faults.empty()) {
    run.environment.insert(
        run.environment.end(),
        {"LD_PRELOAD=" + world.options().faults, "MTDB_FAULT=" + harm, "MTDB_FAULT_UNDER=" + folder,
         "MTDB_FAULT_AT=" + asked.step->Text("spill-at", "1")});
  }
  const std::string place = world.PathOf(asked.store, asked.step->Text("by", "plain"));
  FromPlace(asked, place, {"--cache=" + cache}, answer, run);
  if (!fs::is_empty(folder)) world.Fault("a query leaves a temporary file", folder);
  fs::remove_all(folder);
  // Whether a cache suffices is another question.
  return answer->refused.find("the cache is limited to") == std::string::npos;
}

}  // namespace mtdb::everything
