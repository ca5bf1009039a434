// SPDX-License-Identifier: Apache-2.0
#include "tests/everything/world.h"

#include <algorithm>
#include <csignal>
#include <filesystem>
#include <fstream>
#include <thread>
#include <unistd.h>

#include "store/database.h"

namespace mtdb::everything {

namespace fs = std::filesystem;

namespace {

constexpr size_t kStores = 2;

// What is left of a message without what differs from run to run.
std::string Skeleton(const std::string& message) {
  std::string text;
  std::string word;
  const auto add = [&] {
    if (word.find('/') != std::string::npos) word = "PATH";
    text += word;
    word.clear();
  };
  for (const char c : message.substr(0, message.find('\n'))) {
    if (c == ' ') {
      add();
      text += ' ';
    } else if (c >= '0' && c <= '9') {
      if (word.empty() || word.back() != '#') word += '#';
    } else {
      word += c;
    }
  }
  add();
  return text.substr(0, 140);
}

}  // namespace

Server::Server(const WorldOptions& options, const std::string& store)
    : child_({options.mtdb, "serve", store, "--listen", "127.0.0.1:0", "--threads", "2", "--idle",
              "3600", "--session-idle", "3600", "--timeout", "3600", "--tmp",
              options.folder + "/servertmp"},
             options.folder + "/scratch", {.timeout_seconds = 1e9}) {
  for (int i = 0; i < 20000 && url_.empty(); ++i) {
    const std::string line = child_.out();
    if (line.ends_with('\n')) {
      url_ = line.substr(0, line.size() - 1);
    } else if (!child_.err().empty()) {
      return;
    }
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }
}

int Server::port() const { return std::atoi(url_.substr(url_.rfind(':') + 1).c_str()); }

World::World(WorldOptions options) : options_(std::move(options)), scratch_(Folder("scratch")) {
  for (const char* name : {"scratch", "stores", "inputs", "out", "tmp", "servertmp"}) {
    fs::create_directories(Folder(name));
  }
  std::error_code error;
  fs::create_directory_symlink(Folder("stores"), Folder("linked"), error);
  for (size_t i = 0; i < kStores; ++i) {
    stores_.push_back(std::make_unique<StorePlace>());
    stores_.back()->path = Folder("stores/s" + std::to_string(i) + ".mtdb");
  }
}

StorePlace& World::Store(int64_t number) {
  return *stores_[static_cast<size_t>(number) % stores_.size()];
}

std::string World::PathOf(int64_t store, const std::string& by) {
  const StorePlace& place = Store(store);
  const std::string file = fs::path(place.path).filename().string();
  std::error_code error;
  if (by == "symlink") {
    const std::string link = Folder("stores/symlink-" + file);
    if (!fs::is_symlink(link)) fs::create_symlink(file, link, error);
    return link;
  }
  if (by == "hardlink" && fs::exists(place.path)) {
    const std::string link = Folder("stores/hardlink-" + file);
    if (!fs::exists(link)) fs::create_hard_link(place.path, link, error);
    return link;
  }
  if (by == "folder") return Folder("linked/" + file);
  if (by == "relative") return "../stores/./" + file;  // from inputs/
  return place.path;
}

Ran World::Mtdb(Arguments arguments, RunOptions run) {
  const std::string verb = arguments[0];
  arguments.insert(arguments.begin(), options_.mtdb);
  run.folder = Folder("inputs");
  return Checked(Run(arguments, scratch_, run), "mtdb " + verb);
}

Ran World::Checked(Ran ran, const std::string& what) {
  if (ran.timed_out) Fault(what + ": hangs", ran.err);
  if (ran.signal != 0 && !ran.killed && !ran.timed_out) {
    Fault(what + ": signal " + std::to_string(ran.signal), ran.err);
  }
  for (const char* word : {"runtime error:", "Sanitizer"}) {
    const size_t at = ran.err.find(word);
    if (at != std::string::npos) ErrorFault(what + ": sanitizer", ran.err.substr(at));
  }
  if (ran.exit_code > 2) Fault(what + ": exit code " + std::to_string(ran.exit_code), ran.err);
  // What verify finds wrong is its report.
  const bool is_report = what == "mtdb verify" && ran.err.empty() && !ran.out.empty();
  const bool one_line =
      is_report || (ran.err.starts_with("mtdb: ") && ran.err.find('\n') == ran.err.size() - 1);
  if ((ran.exit_code == 1 || ran.exit_code == 2) && !one_line && ran.signal == 0) {
    ErrorFault(what + ": not one line of error", ran.err);
  }
  return ran;
}

void World::Fault(const std::string& kind, const std::string& detail) {
  ++counts_.faults;
  const Json fault = {{"kind", kind}, {"step", step_}, {"detail", detail.substr(0, 2000)}};
  std::ofstream(Folder("faults"), std::ios::app)
      << fault.dump(-1, ' ', false, Json::error_handler_t::replace) << "\n";
}

void World::ErrorFault(const std::string& kind, const std::string& message) {
  Fault(kind + ": " + Skeleton(message), message);
}

void World::Note(const std::string& where) {
  WriteText(Folder("where"), std::to_string(step_) + " " + where);
}

void World::Walk(const everything::Walk& walk) {
  for (step_ = 0; step_ < walk.steps.size() && !stopped_; ++step_) {
    const Step& step = walk.steps[step_];
    Note(step.act);
    ++counts_.steps;
    if (const Act act = ActOf(step.act)) {
      act(*this, step);
    } else {
      Fault("no such act", step.act);
    }
    WriteText(Folder("counts"), std::to_string(counts_.steps) + " " + std::to_string(counts_.acts) +
                                    " " + std::to_string(counts_.questions) + " " +
                                    std::to_string(counts_.answers));
  }
  Note("end");
  for (const auto& place : stores_) {
    for (auto& [name, session] : place->sessions) {
      if (session != nullptr) session->Close();
    }
    place->sessions.clear();
    if (place->server) {
      const std::string errors = place->server->errors();
      if (!errors.empty()) ErrorFault("serve: prints errors", errors);
    }
    place->server.reset();
  }
}

Result<ObjectRecord> ReadRecord(const std::string& store, const std::string& name) {
  MTDB_ASSIGN_OR_RETURN(const std::shared_ptr<Database> database, Database::Open(store));
  return database->Find(name);
}

}  // namespace mtdb::everything
