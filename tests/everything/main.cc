// SPDX-License-Identifier: Apache-2.0
// everything: random walks through the whole product, held against a small model. README.md says
// how to run it and how to teach it something new.
#include <algorithm>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <map>
#include <mutex>
#include <optional>
#include <sstream>
#include <thread>
#include <unistd.h>

#include "tests/everything/random_walk.h"
#include "tests/everything/shrink.h"
#include "tests/everything/world.h"

namespace mtdb::everything {

namespace fs = std::filesystem;
using Clock = std::chrono::steady_clock;

namespace {

constexpr const char* kUsage =
    "usage: everything [--mtdb PATH] [--seed S] [--walks N | --minutes M | --hours H] [--jobs J]\n"
    "                  [--findings DIR] [--tmp DIR] [--timeout SECONDS] [--shrink ATTEMPTS]\n"
    "       everything [--mtdb PATH] --replay FILE [--keep]\n"
    "       everything --print --seed S\n";

struct Options {
  std::string mtdb = MTDB_BINARY;
  uint64_t seed = 1;
  uint64_t walks = 0;
  double minutes = 0;
  unsigned jobs = 1;
  std::string findings;  // where shrunk walks go; empty: only printed
  std::string tmp = fs::temp_directory_path().string();
  double timeout_seconds = 1200;  // of a walk
  int shrink = 150;
  std::string replay;
  bool keep = false;
  bool print = false;
  std::string walk_here;  // the mode of a child: the folder
};

struct Fault {
  std::string kind, detail;
  uint64_t step = 0;
};

struct Outcome {
  std::vector<Fault> faults;
  Counts counts;
};

// Walks in a child process, in a folder that goes with it.
Outcome WalkInChild(const Options& options, const Walk& walk, bool keep = false) {
  std::string folder = options.tmp + "/mtdb-everything-" + std::string(6, 'X');  // for mkdtemp
  if (::mkdtemp(folder.data()) == nullptr) {
    return {{{"no temporary folder", folder, 0}}, {}};
  }
  WriteText(folder + "/walk", WalkText(walk));
  fs::create_directory(folder + "/log");
  const std::string self = fs::read_symlink("/proc/self/exe").string();
  const Ran ran = Run({self, "--mtdb", options.mtdb, "--walk-here", folder}, folder + "/log",
                      {.timeout_seconds = options.timeout_seconds});
  Outcome outcome;
  std::istringstream lines(ReadText(folder + "/faults"));
  std::string line;
  while (std::getline(lines, line)) {
    const auto json = nlohmann::json::parse(line, nullptr, false);
    if (!json.is_object()) continue;
    outcome.faults.push_back({json.at("kind"), json.at("detail"), json.at("step")});
  }
  std::istringstream where(ReadText(folder + "/where"));
  uint64_t step = 0;
  std::string what;
  where >> step;
  std::getline(where, what);
  if (ran.timed_out) {
    outcome.faults.push_back({"the walk hangs:" + what, ran.err, step});
  } else if (!ran.ok()) {
    outcome.faults.push_back({"the walk's process ends by " +
                                  (ran.signal != 0 ? "signal " + std::to_string(ran.signal)
                                                   : "exit " + std::to_string(ran.exit_code)) +
                                  ":" + what,
                              ran.err, step});
  }
  std::istringstream counts(ReadText(folder + "/counts"));
  Counts& c = outcome.counts;
  counts >> c.steps >> c.acts >> c.questions >> c.answers;
  if (keep) {
    std::printf("kept: %s\n", folder.c_str());
  } else {
    std::error_code error;
    fs::remove_all(folder, error);
  }
  return outcome;
}

int WalkHere(const Options& options) {
  const Result<Walk> walk = ParseWalk(ReadText(options.walk_here + "/walk"));
  if (!walk.ok()) {
    std::fprintf(stderr, "%s\n", walk.status().message().c_str());
    return 2;
  }
  World world({options.mtdb, options.walk_here, MTDB_FAULTS});
  world.Walk(*walk);
  return 0;
}

int Replay(const Options& options) {
  const Result<Walk> walk = ParseWalk(ReadText(options.replay));
  if (!walk.ok()) {
    std::fprintf(stderr, "%s: %s\n", options.replay.c_str(), walk.status().message().c_str());
    return 2;
  }
  const Outcome outcome = WalkInChild(options, *walk, options.keep);
  for (const Fault& f : outcome.faults) {
    std::printf("step %llu: %s\n    %s\n", static_cast<unsigned long long>(f.step), f.kind.c_str(),
                f.detail.c_str());
  }
  std::printf("%zu faults in %zu steps\n", outcome.faults.size(), walk->steps.size());
  return outcome.faults.empty() ? 0 : 1;
}

// Many walks on several threads, each in a process of its own.
class Campaign {
 public:
  explicit Campaign(const Options& options) : options_(options), next_seed_(options.seed) {}

  int Run() {
    std::vector<std::jthread> threads;
    for (unsigned i = 0; i < options_.jobs; ++i) threads.emplace_back([this] { Work(); });
    threads.clear();
    std::printf(
        "%llu walks, %llu steps, %llu processes and acts, %llu questions, %llu answers; "
        "%zu kinds of faults in %llu faults; %.0f s\n",
        U(walks_), U(counts_.steps), U(counts_.acts), U(counts_.questions), U(counts_.answers),
        seen_.size(), U(counts_.faults), Seconds());
    for (const auto& [kind, times] : seen_) {
      std::printf("  %llu x %s\n", U(times), kind.c_str());
    }
    return seen_.empty() ? 0 : 1;
  }

 private:
  static unsigned long long U(uint64_t n) { return n; }
  double Seconds() const { return std::chrono::duration<double>(Clock::now() - begin_).count(); }

  std::optional<uint64_t> TakeSeed() {
    const std::lock_guard lock(mutex_);
    if (options_.minutes > 0 ? Seconds() > 60 * options_.minutes
                             : next_seed_ - options_.seed >= options_.walks) {
      return std::nullopt;
    }
    return next_seed_++;
  }

  void Work() {
    while (const auto seed = TakeSeed()) {
      const Walk walk = RandomWalk(*seed);
      const Outcome outcome = WalkInChild(options_, walk);
      std::vector<Fault> fresh;
      {
        const std::lock_guard lock(mutex_);
        ++walks_;
        counts_.steps += outcome.counts.steps;
        counts_.acts += outcome.counts.acts;
        counts_.questions += outcome.counts.questions;
        counts_.answers += outcome.counts.answers;
        counts_.faults += outcome.faults.size();
        for (const Fault& f : outcome.faults) {
          if (++seen_[f.kind] != 1) continue;
          fresh.push_back(f);
          std::printf("%6.0f s: seed %llu, step %llu: %s\n    %s\n", Seconds(), U(*seed), U(f.step),
                      f.kind.c_str(), f.detail.c_str());
          std::fflush(stdout);
        }
      }
      for (const Fault& f : fresh) Report(walk, f);
    }
  }

  // Shrinks the walk and says what is left of it.
  void Report(const Walk& walk, const Fault& fault) {
    const auto fails = [&](const Walk& candidate) {
      const auto faults = WalkInChild(options_, candidate).faults;
      return std::ranges::find(faults, fault.kind, &Fault::kind) != faults.end();
    };
    Walk shrunk = walk;
    // What comes after the step cannot matter, whatever is left of the attempts.
    if (fault.step + 1 < shrunk.steps.size()) {
      shrunk.steps.resize(fault.step + 1);
      if (!fails(shrunk)) shrunk = walk;
    }
    shrunk = Shrink(shrunk, fails, options_.shrink);
    const std::lock_guard lock(mutex_);
    std::string text = "# " + fault.kind + "\n" + WalkText(shrunk);
    std::printf("%6.0f s: shrunk to %zu of %zu steps; everything --replay FILE with\n%s\n",
                Seconds(), shrunk.steps.size(), walk.steps.size(), text.c_str());
    std::fflush(stdout);
    if (options_.findings.empty()) return;
    fs::create_directories(options_.findings);
    WriteText(options_.findings + "/" + std::to_string(walk.seed) + "-" +
                  std::to_string(++findings_) + ".walk",
              text);
  }

  const Options options_;
  const Clock::time_point begin_ = Clock::now();
  std::mutex mutex_;
  uint64_t next_seed_;
  uint64_t walks_ = 0;
  int findings_ = 0;
  Counts counts_;
  std::map<std::string, uint64_t> seen_;
};

// False: wrong usage.
bool Parse(int count, char** arguments, Options* options) {
  for (int i = 1; i < count; ++i) {
    const std::string key = arguments[i];
    if (key == "--keep" || key == "--print") {
      (key == "--keep" ? options->keep : options->print) = true;
      continue;
    }
    if (++i == count) return false;
    const std::string value = arguments[i];
    const double number = std::atof(value.c_str());
    if (key == "--mtdb") {
      options->mtdb = fs::absolute(value).string();
    } else if (key == "--seed") {
      options->seed = std::strtoull(value.c_str(), nullptr, 10);
    } else if (key == "--walks") {
      options->walks = std::strtoull(value.c_str(), nullptr, 10);
    } else if (key == "--minutes") {
      options->minutes = number;
    } else if (key == "--hours") {
      options->minutes = 60 * number;
    } else if (key == "--jobs") {
      options->jobs = static_cast<unsigned>(std::clamp(number, 1.0, 64.0));
    } else if (key == "--findings") {
      options->findings = value;
    } else if (key == "--tmp") {
      options->tmp = fs::absolute(value).string();
    } else if (key == "--timeout") {
      options->timeout_seconds = number;
    } else if (key == "--shrink") {
      options->shrink = static_cast<int>(number);
    } else if (key == "--replay") {
      options->replay = value;
    } else if (key == "--walk-here") {
      options->walk_here = value;
    } else {
      return false;
    }
  }
  return true;
}

}  // namespace

int Main(int count, char** arguments) {
  const std::string mode = count > 1 ? arguments[1] : "";
  if (mode == "--measure") return MeasureMain(count - 2, arguments + 2);
  if (mode == "--library-ingest") return LibraryIngestMain(count - 2, arguments + 2);
  Options options;
  if (!Parse(count, arguments, &options)) {
    std::fputs(kUsage, stderr);
    return 2;
  }
  if (options.print) {
    std::fputs(WalkText(RandomWalk(options.seed)).c_str(), stdout);
    return 0;
  }
  if (!options.walk_here.empty()) return WalkHere(options);
  if (!options.replay.empty()) return Replay(options);
  if (options.walks == 0 && options.minutes <= 0) options.walks = 1;
  return Campaign(options).Run();
}

}  // namespace mtdb::everything

int main(int count, char** arguments) { return mtdb::everything::Main(count, arguments); }
