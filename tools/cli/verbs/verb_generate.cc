// SPDX-License-Identifier: Apache-2.0
#include <cstdio>

#include "tools/cli/grouped.h"
#include "tools/cli/options.h"
#include "tools/cli/verbs.h"
#include "tools/generate/generate.h"
#include "tools/request/report_json.h"

namespace mtdb {

namespace {

struct GenerateArguments {
  std::string shape;
  std::string output;
  uint64_t triangles = 0;
  uint64_t seed = 1;
  bool json = false;
};
Status Generate(const GenerateArguments& arguments) {
  GenerateReport report;
  MTDB_RETURN_IF_ERROR(GenerateFile(arguments.shape,
                                    {.triangles = arguments.triangles, .seed = arguments.seed},
                                    arguments.output, &report));
  if (arguments.json) {
    PrintAnswer("generate", {{"output", arguments.output},
                             {"vertices", report.vertices},
                             {"triangles", report.triangles}});
  } else {
    std::printf("%s: %s triangles, %s vertices\n", arguments.output.c_str(),
                Grouped(report.triangles).c_str(), Grouped(report.vertices).c_str());
  }
  return Status::Ok();
}

RunVerb AddGenerate(VerbOptions* verb) {
  const auto a = std::make_shared<GenerateArguments>();
  verb->Add("SHAPE", a->shape,
            "sculpture (closed, with handles and bumps of all sizes), terrain (a height field) or "
            "sheets (not manifold: a closed surface, two-sided on a third of its area, with fins, "
            "flaps and crumbs)")
      .Required()
      .OneOf({"sculpture", "terrain", "sheets"});
  AddOutput(verb, &a->output);
  const auto parse = [](const std::string& text) -> Result<uint64_t> {
    auto count = ParseCount(text);
    if (!count.ok() || (*count >= 100 && *count <= 8'300'000'000)) return count;
    return Unexpected(text, "a number from 100 to 8300000000");
  };
  AddParsed(verb, "--triangles", "N", &a->triangles, parse,
            "about N triangles, from 100 to 8300M (as far as indices of 32 bits go), e.g. 100k; "
            "required")
      .Required();
  AddJson(verb, &a->json);
  AddParsed(verb, "--seed", "S", &a->seed, ParseWholeNumber, "another number, another shape")
      .Default("1");
  return [a](Invocation&) { return Generate(*a); };
}

}  // namespace

const Verb kGenerateVerb{"generate", "make a mesh to try things on",
                         "Example: mtdb generate sculpture try.ply --triangles 1000000",
                         AddGenerate};

}  // namespace mtdb
