// SPDX-License-Identifier: Apache-2.0
#include "tools/client/internal/blocking_connection.h"

namespace mtdb::internal {

Status BlockingConnection::Connect() {
  Tcp::resolver resolver(io_);
  ErrorCode error;
  const auto endpoints = resolver.resolve(url_.host, url_.port, error);
  if (error) return Failure("no such host", error);
  error = Await(
      [&](auto&& done) { stream_.async_connect(endpoints, std::forward<decltype(done)>(done)); });
  if (error) return Failure("cannot connect", error);
  ErrorCode ignored;
  stream_.socket().set_option(Tcp::no_delay(true), ignored);
  return Status::Ok();
}

Status BlockingConnection::Failure(const std::string& what, ErrorCode error) const {
  std::string why = error.message();
  if (error == beast::error::timeout) why = "the server does not answer";
  if (error == http::error::end_of_stream || error == http::error::partial_message ||
      error == asio::error::eof || error == asio::error::connection_reset ||
      error == asio::error::broken_pipe || error == websocket::error::closed) {
    why = "the server closed the connection";
  }
  return IoError(url_.origin() + ": " + what + ": " + why);
}

}  // namespace mtdb::internal
