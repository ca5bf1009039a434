// SPDX-License-Identifier: Apache-2.0
// World: what a walk acts on: a folder of stores, servers, sessions, and the model of all that.
#pragma once

#include <memory>
#include <optional>
#include <set>
#include <string>

#include "codecs/stream/update_stream.h"
#include "query/session.h"
#include "tests/everything/model.h"
#include "tests/everything/process.h"
#include "tests/everything/question.h"
#include "tools/client/client.h"

namespace mtdb::everything {

struct WorldOptions {
  std::string mtdb;         // the program
  std::string folder;       // of this walk alone; exists
  std::string faults = {};  // the library that makes operations on files fail; empty: none
};

// `mtdb serve` of one store.
class Server {
 public:
  Server(const WorldOptions& options, const std::string& store);
  const std::string& url() const { return url_; }  // empty: it did not come up
  int port() const;
  std::string errors() const { return child_.err(); }

 private:
  Child child_;
  std::string url_;
};

// An update stream without a server: who sends, and who follows.
struct ProcessStream {
  ProcessStream(std::unique_ptr<Session> from, const ClientMeshOptions& options,
                const BaseMesh& base)
      : session(std::move(from)), encoder(options, base) {}
  std::unique_ptr<Session> session;
  UpdateEncoder encoder;
  UpdateDecoder decoder;
};

struct StorePlace {
  std::string path;
  StoreModel model;
  std::unique_ptr<Server> server;
  std::map<std::string, std::unique_ptr<RemoteSession>> sessions;  // by object
  std::map<std::string, std::unique_ptr<ProcessStream>> streams;   // by object

  // What has the object open, which is gone or another one.
  void Close(const std::string& name) {
    sessions.erase(name);
    streams.erase(name);
  }
};

// What was done and seen.
struct Counts {
  uint64_t steps = 0, acts = 0, questions = 0, answers = 0, faults = 0;
};

class World {
 public:
  explicit World(WorldOptions options);

  // Does all steps; returns when they are done, or when a store is not what it must be.
  void Walk(const Walk& walk);

  const WorldOptions& options() const { return options_; }
  std::string Folder(const std::string& name) const { return options_.folder + "/" + name; }
  const std::string& scratch() const { return scratch_; }
  StorePlace& Store(int64_t number);
  // The path by which a step names a store: plain, relative, symlink, hardlink, folder (a link).
  std::string PathOf(int64_t store, const std::string& by);

  // Runs mtdb; reports signals, time-outs and what sanitizers say.
  Ran Mtdb(Arguments arguments, RunOptions run = {});
  Ran Checked(Ran ran, const std::string& what);

  // Notes a fault of the current step. `kind` is what tells faults apart; shrinking keeps it.
  void Fault(const std::string& kind, const std::string& detail);
  // `kind` with a message, less its numbers and paths.
  void ErrorFault(const std::string& kind, const std::string& message);
  // No more steps after this one.
  void Stop() { stopped_ = true; }
  bool stopped() const { return stopped_; }
  // Where the walk is, for who has to say where it ended.
  void Note(const std::string& where);

  Counts& counts() { return counts_; }
  // In stores/ and tmp/, beside stores and locks; journals with whose they are (WorkOf in acts.cc).
  std::map<std::string, std::string> expected_files;
  // Ingests that were killed: what they were told, less the kill; by store and name.
  std::map<std::string, Step> interrupted;

 private:
  WorldOptions options_;
  std::string scratch_;
  std::vector<std::unique_ptr<StorePlace>> stores_;
  size_t step_ = 0;
  bool stopped_ = false;
  Counts counts_;
};

// acts.cc: the table of acts.
using Act = void (*)(World& world, const Step& step);
Act ActOf(const std::string& name);  // null: none of that name
std::vector<std::string> ActNames();

bool HasStore(const StorePlace& place);
// What holds after every act: no file is there that nobody expects; the store lists what the model
// has, and verify agrees; an object is what it was.
void CheckLeftovers(World& world);
void CheckStore(World& world, int64_t number, const std::string& level);
void CheckObject(World& world, int64_t number, const std::string& name);

// space_acts.cc: objects and stores that move.
void RenameAct(World& world, const Step& step);
void CopyIntoAct(World& world, const Step& step);
void CompactAct(World& world, const Step& step);
// A packed file of the store, by its path and by its URL: verified, and given up in the middle.
void VerifyPacked(World& world, const Step& step);
// Runs mtdb, killed at an operation on files where the step says so.
Ran RunOrKill(World& world, const Step& step, Arguments arguments);

// output_acts.cc: pictures by every attribute; a packed file where a store is.
void PictureAct(World& world, const Step& step);
void PackOntoAct(World& world, const Step& step);
// A mesh or a picture is written to where a link to a store or a packed file is.
void AimAct(World& world, const Step& step);
// An ingest of standard input that never ends.
void PourAct(World& world, const Step& step);
// The viewer's files for any web server, written twice.
void PageAct(World& world, const Step& step);
// tile_acts.cc: trees of tiles, of the store and of its packed file, also after a kill.
void TileAct(World& world, const Step& step);
// beside_acts.cc: an object is read while an act changes it.
void BesideAct(World& world, const Step& step);
// terrain_acts.cc: rasters of heights, from the files to every answer.
void TerrainAct(World& world, const Step& step);

// What a way of asking has brought.
struct Answer {
  std::string way;
  std::string format;  // of the file that it came in; empty: none
  TriangleMesh mesh;
  bool has_rows = false;   // attributes as stored
  bool has_order = true;   // vertices that triangles share
  bool exact = false;      // positions in double; else compared as float32
  bool lossy = false;      // a format that rounds as it likes
  bool any_bound = false;  // the bound may be smaller than that of a fresh query
  double bound = 0;
  std::string limit;
  uint64_t triangles = 0;  // as told
  uint64_t active = 1;     // of them within reach of the region, where it is told
  double excess = 0;       // by what it says that the threshold is not kept
  std::string refused;     // why there is no mesh; empty: there is one
};

struct Asked {
  World* world;
  int64_t store;
  std::string name;
  const StoredObject* object;
  const Question* question;
  const Step* step;
};
// ways.cc: the table of ways of asking. False: this way cannot ask that.
using Way = bool (*)(const Asked& asked, Answer* answer);
struct NamedWay {
  const char* name;
  Way ask;
};
const std::vector<NamedWay>& Ways();

// judge.cc: holds an answer against the model. `reference`: the first way's answer, or null; its
// faults are not told again. Returns what was wrong.
std::set<std::string> Judge(const Asked& asked, const Answer& answer, const Answer* reference,
                            const std::set<std::string>& told = {});
// probe.cc: asks for the closest point, or casts a ray, in every way, and judges what comes.
void JudgeProbe(World& world, const Step& step, int64_t store, const std::string& name,
                const StoredObject& object);
// The record of an object in a store, as the library reads it.
Result<ObjectRecord> ReadRecord(const std::string& store, const std::string& name);

// The mode that library ingests go through: a process of its own.
int LibraryIngestMain(int count, char** arguments);

}  // namespace mtdb::everything
