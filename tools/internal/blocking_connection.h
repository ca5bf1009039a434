// BlockingConnection: a TCP connection for one thread, which waits for each operation, but not for
// ever.
#pragma once

#include <boost/asio/io_context.hpp>
#include <boost/asio/steady_timer.hpp>
#include <boost/beast/core/tcp_stream.hpp>
#include <string>
#include <utility>

#include "store/base/status.h"
#include "tools/internal/http_client.h"
#include "tools/internal/network.h"

namespace mtdb {

class BlockingConnection {
 public:
  // `idle_seconds`: how long an operation may take.
  BlockingConnection(HttpUrl url, double idle_seconds)
      : url_(std::move(url)), idle_(Seconds(idle_seconds)) {}

  // kIoError.
  Status Connect();
  // Runs `start(handler)`, an asynchronous operation on the stream, to its end. One that takes too
  // long closes the connection and is beast::error::timeout.
  template <typename Start>
  ErrorCode Await(Start&& start) {
    ErrorCode result;
    bool late = false;
    asio::steady_timer timer(io_, idle_);
    timer.async_wait([&](ErrorCode error) {
      if (error) return;
      late = true;
      stream_.close();
    });
    start([&](ErrorCode error, auto&&...) {
      result = error;
      timer.cancel();
    });
    io_.restart();
    io_.run();
    return late ? ErrorCode(beast::error::timeout) : result;
  }
  // kIoError: the server, what was tried, and why it failed.
  Status Failure(const std::string& what, ErrorCode error) const;
  const HttpUrl& url() const { return url_; }
  beast::tcp_stream& stream() { return stream_; }

 private:
  const HttpUrl url_;
  const Clock::duration idle_;
  asio::io_context io_{1};
  beast::tcp_stream stream_{io_};
};

}  // namespace mtdb
