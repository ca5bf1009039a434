// SPDX-License-Identifier: Apache-2.0
// What the ways of asking share (ways.cc), and those that are in files of their own.
#pragma once

#include <string>

#include "query/surface.h"
#include "tests/everything/world.h"

namespace mtdb::everything {

// A name of the walk's folder that nobody has yet.
std::string NewFile(const Asked& asked, const std::string& extension);
// What the library says of an answer.
void Take(const ExtractStats& stats, Answer* answer);
// What a client of an update stream holds.
void TakeClientMesh(const ClientMesh& client, Answer* answer);
MeetsRegion MeetsOf(const Query& query);
// The questions that lead to this one in `moves` small steps, the first one first.
std::vector<Question> MovesTowards(const Asked& asked);
// Reads what a program says as JSON, and the file that it wrote, which is then removed.
void ReadAnswerJson(const std::string& text, Answer* answer);
void ReadAnswerFile(const std::string& path, Answer* answer);

// The object alone, packed; empty when that fails, and `answer` says why.
std::string Packed(const Asked& asked, Answer* answer);
// Asks the command line for the object where it is: a file or a URL.
void FromPlace(const Asked& asked, const std::string& place, const Arguments& more, Answer* answer,
               const RunOptions& run = {});
// A server of the store.
Server* Serving(const Asked& asked);
std::string ObjectPath(const Asked& asked);
void FromHttp(const Asked& asked, const std::string& method, const std::string& target,
              const std::string& body, Answer* answer);

// available_ways.cc: asked again and again, never waited for, until all is there.
bool AskAvailable(const Asked& asked, Answer* answer);
bool AskAvailableStream(const Asked& asked, Answer* answer);
// process_ways.cc: the Python package, where numpy is; a pipe, by a link to its descriptor.
bool AskPython(const Asked& asked, Answer* answer);
bool AskPipe(const Asked& asked, Answer* answer);
// remote_ways.cc: a server's /packed; a folder of kept ranges that is harmed; JSON that waits for
// nothing; a cache that is too small, whose file on disk fails.
bool AskServedPacked(const Asked& asked, Answer* answer);
bool AskKept(const Asked& asked, Answer* answer);
bool AskAvailableJson(const Asked& asked, Answer* answer);
bool AskSmallCache(const Asked& asked, Answer* answer);

}  // namespace mtdb::everything
