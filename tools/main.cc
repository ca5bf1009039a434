// mtdb: the command line. Exit status 0 success, 1 error, 2 usage.

#include <CLI/CLI.hpp>
#include <csignal>
#include <cstdio>
#include <string>
#include <vector>

#include "tools/internal/verbs.h"

namespace {

constexpr int kExitError = 1;
constexpr int kExitUsage = 2;

void AddName(CLI::App* verb, std::string* name) {
  verb->add_option("--name", *name, "the object; not needed when the store has one");
}

void AddQueryOptions(CLI::App* verb, mtdb::QueryArguments* a) {
  AddName(verb, &a->name);
  auto* full = verb->add_flag("--full", a->full, "the input's resolution (default)");
  auto* error = verb->add_option("--error", a->error, "largest error, in model units")
                    ->check(CLI::NonNegativeNumber);
  auto* relative = verb->add_option("--error-rel", a->error_relative,
                                    "largest error, as a fraction of the bounding box's diagonal")
                       ->check(CLI::NonNegativeNumber);
  auto* triangles = verb->add_option("--triangles", a->triangles,
                                     "at most so many triangles, at the best accuracy they allow")
                        ->check(CLI::PositiveNumber);
  full->excludes(error)->excludes(relative)->excludes(triangles);
  error->excludes(relative);
  verb->add_option("--box", a->box, "where that accuracy is wanted: X0,Y0,Z0,X1,Y1,Z1");
  verb->add_option("--sphere", a->sphere, "likewise: X,Y,Z,RADIUS");
  verb->add_flag("--clip", a->clip, "leave out triangles that do not meet the region");
  verb->add_flag("--json", a->json, "print the result as JSON");
}

}  // namespace

int main(int argc, char** argv) {
  // A store on a full quota or a closed pipe is an error to report, not a reason to die.
  std::signal(SIGXFSZ, SIG_IGN);
  std::signal(SIGPIPE, SIG_IGN);

  CLI::App app{"mtdb: an out-of-core database of triangle meshes (Multi-Triangulations)"};
  app.name("mtdb");
  app.set_version_flag("--version", std::string("mtdb ") + MTDB_VERSION);
  app.require_subcommand(1);
  app.footer("'mtdb help VERB' tells the options of a verb.");

  mtdb::IngestArguments ingest;
  CLI::App* ingest_verb = app.add_subcommand("ingest", "build the MT of a mesh and store it");
  std::vector<std::string> paths;
  ingest_verb
      ->add_option("INPUT... STORE", paths,
                   "mesh files (.ply .obj .stl .off; several become one object), then the store")
      ->required()
      ->expected(2, 1 << 20);
  ingest_verb->add_option("--name", ingest.name, "the object's name (default: INPUT's stem)");
  auto* bits = ingest_verb
                   ->add_option("--bits", ingest.bits,
                                "cells of the grid along the longest side, as a power of two")
                   ->check(CLI::Range(1, 24))
                   ->capture_default_str();
  auto* step = ingest_verb->add_option("--step", ingest.step, "cell of the grid, in model units")
                   ->check(CLI::PositiveNumber);
  auto* lossless =
      ingest_verb->add_flag("--lossless", ingest.lossless, "keep float32 positions bit for bit");
  bits->excludes(step)->excludes(lossless);
  step->excludes(lossless);
  ingest_verb->add_option("--threads", ingest.threads, "threads (default: one per core)")
      ->check(CLI::Range(1, 1024));
  ingest_verb->add_option("--memory", ingest.memory,
                          "refuse to use more, e.g. 4G (default: a quarter of the machine's)");
  ingest_verb->add_flag("--force", ingest.force, "replace an object of that name");
  ingest_verb->add_flag("--quiet", ingest.quiet, "print nothing but errors");
  ingest_verb->add_flag("--json", ingest.json, "print the result as JSON");

  mtdb::InspectArguments inspect;
  CLI::App* info_verb = app.add_subcommand("info", "what the store holds, in detail");
  CLI::App* list_verb = app.add_subcommand("list", "the objects of a store");
  CLI::App* verify_verb = app.add_subcommand("verify", "check a store's bytes and meshes");
  CLI::App* remove_verb = app.add_subcommand("remove", "remove an object from a store");
  for (CLI::App* verb : {info_verb, list_verb, verify_verb, remove_verb}) {
    verb->add_option("STORE", inspect.store, "the store file")->required();
    if (verb != remove_verb) verb->add_flag("--json", inspect.json, "print the result as JSON");
  }
  AddName(info_verb, &inspect.name);
  AddName(verify_verb, &inspect.name);
  verify_verb
      ->add_option("--level", inspect.level,
                   "fast: pages, checksums, index; full: also decodes everything; "
                   "global: also compares the surface with what was ingested")
      ->check(CLI::IsMember({"fast", "full", "global"}))
      ->capture_default_str();
  remove_verb->add_option("NAME", inspect.name, "the object")->required();

  mtdb::QueryArguments query;
  CLI::App* extract_verb = app.add_subcommand("extract", "a mesh of a region at an accuracy");
  extract_verb->add_option("STORE", query.store, "the store file")->required();
  extract_verb->add_option("OUTPUT", query.output, "mesh file: .ply .obj .stl .off .drc")
      ->required();
  AddQueryOptions(extract_verb, &query);
  CLI::App* render_verb = app.add_subcommand("render", "a picture of what extract would return");
  render_verb->add_option("STORE", query.store, "the store file")->required();
  render_verb->add_option("OUT.png", query.output, "the picture")->required();
  AddQueryOptions(render_verb, &query);
  render_verb->add_option("--size", query.size, "pixels: WIDTHxHEIGHT")->capture_default_str();
  render_verb->add_flag("--wireframe", query.wireframe, "draw the triangles' edges");

  mtdb::GenerateArguments generate;
  CLI::App* generate_verb = app.add_subcommand("generate", "make a mesh to try things on");
  generate_verb->add_option("SHAPE", generate.shape, "sculpture or terrain")
      ->required()
      ->check(CLI::IsMember({"sculpture", "terrain"}));
  generate_verb->add_option("OUTPUT", generate.output, "mesh file, binary PLY")->required();
  generate_verb->add_option("--triangles", generate.triangles, "about so many")->required();
  generate_verb->add_option("--seed", generate.seed, "another seed, another shape")
      ->capture_default_str();

  // "mtdb help VERB" is "mtdb VERB --help".
  std::vector<std::string> arguments(argv + 1, argv + argc);
  if (!arguments.empty() && arguments[0] == "help") {
    arguments.erase(arguments.begin());
    arguments.resize(std::min<size_t>(arguments.size(), 1));
    arguments.push_back("--help");
  }
  try {
    std::vector<std::string> reversed(arguments.rbegin(), arguments.rend());
    app.parse(reversed);
  } catch (const CLI::Success& e) {
    return app.exit(e);
  } catch (const CLI::ParseError& e) {
    const auto verbs = app.get_subcommands();
    std::fprintf(stderr, "mtdb: %s; see 'mtdb help%s%s'\n", e.what(), verbs.empty() ? "" : " ",
                 verbs.empty() ? "" : verbs[0]->get_name().c_str());
    return kExitUsage;
  }

  mtdb::Status status;
  bool ok = true;
  if (ingest_verb->parsed()) {
    ingest.store = paths.back();
    ingest.inputs.assign(paths.begin(), paths.end() - 1);
    status = mtdb::Ingest(ingest);
  } else if (info_verb->parsed()) {
    status = mtdb::Info(inspect);
  } else if (list_verb->parsed()) {
    status = mtdb::List(inspect);
  } else if (verify_verb->parsed()) {
    status = mtdb::Verify(inspect, &ok);
  } else if (remove_verb->parsed()) {
    status = mtdb::Remove(inspect);
  } else if (extract_verb->parsed()) {
    status = mtdb::ExtractVerb(query);
  } else if (render_verb->parsed()) {
    status = mtdb::RenderVerb(query);
  } else {
    status = mtdb::Generate(generate);
  }
  if (!status.ok()) {
    std::fprintf(stderr, "mtdb: %s\n", status.message().c_str());
    // A malformed value of an option is a usage error like an unknown option.
    return status.code() == mtdb::StatusCode::kInvalidArgument ? kExitUsage : kExitError;
  }
  if (std::fflush(stdout) != 0) {
    std::fprintf(stderr, "mtdb: standard output cannot be written; is the disk full?\n");
    return kExitError;
  }
  return ok ? 0 : kExitError;
}
