# SPDX-License-Identifier: Apache-2.0
"""Work that takes long: progress, and Ctrl-C, while the library runs without the GIL."""
from __future__ import annotations

import ctypes as C
import os
import select
import signal
import threading
from typing import Any, Callable, Iterator, Optional, Union
from contextlib import contextmanager

from ._errors import Cancelled
from ._library import Handle, ProbeOptions, ProgressFunction, Watch, ask

#: Called with what is done now and 0..1 (negative: nobody knows); False stops the work. True: a
#: progress bar by tqdm, when it is installed.
Progress = Union[bool, Callable[[str, float], Optional[bool]], None]


class _Wait:
    """What the main thread waits for."""

    def __init__(self, control: Handle) -> None:
        self.control = control
        self.interrupted = False


class _Interrupts:
    """Cancels what the main thread waits for when Ctrl-C arrives. Python's own handler runs when the
    library has returned: so a thread reads the byte that Python writes at once for each signal. Who
    reads a byte holds the lock until it is dealt with: so no later work is cancelled by it."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._waits: list[_Wait] = []
        self._pid = 0
        self._read = self._write = -1
        self._before = -1

    def _start(self) -> None:
        self._pid = os.getpid()
        self._lock = threading.Lock()
        self._waits = []
        self._read, self._write = os.pipe()
        os.set_blocking(self._write, False)
        os.set_blocking(self._read, False)
        threading.Thread(target=self._listen, args=(self._read,), daemon=True).start()

    def _take(self) -> None:
        """Reads what has come and cancels what is under way; with the lock."""
        try:
            numbers = os.read(self._read, 64)
        except BlockingIOError:  # the other thread was first
            return
        if signal.SIGINT in numbers:
            for wait in self._waits:
                wait.interrupted = True
                ask("cancel", wait.control)
        if self._before >= 0:
            try:
                os.write(self._before, numbers)
            except OSError:
                pass

    def _listen(self, read: int) -> None:
        while True:
            select.select([read], [], [])
            with self._lock:
                self._take()

    @contextmanager
    def cancel(self, control: Handle) -> Iterator[None]:
        if (
            threading.current_thread() is not threading.main_thread()
            or signal.getsignal(signal.SIGINT) is not signal.default_int_handler
        ):
            yield
            return
        if self._pid != os.getpid():
            self._start()
        wait = _Wait(control)
        with self._lock:
            self._take()  # of a signal that ended earlier work
            self._waits.append(wait)
        before = signal.set_wakeup_fd(self._write, warn_on_full_buffer=False)
        if before != self._write:
            self._before = before
        try:
            yield
        except Cancelled:
            if wait.interrupted:
                raise KeyboardInterrupt from None
            raise
        finally:
            signal.set_wakeup_fd(before)
            with self._lock:
                self._waits.remove(wait)
        if wait.interrupted:  # Python's own was lost in a destructor
            raise KeyboardInterrupt


_interrupts = _Interrupts()


@contextmanager
def interruptible() -> Iterator[Handle]:
    """A control that Ctrl-C cancels."""
    control = Handle("control", "create_control")
    with _interrupts.cancel(control):
        yield control


def probe_options(error: Optional[float], control: Handle) -> ProbeOptions:
    """Without an error: at full resolution."""
    return ProbeOptions(error=error or 0.0, control=control.value)


class Watched:
    """An mtdb_watch, and what its callback raised."""

    def __init__(self, progress: Progress) -> None:
        self.raised: BaseException | None = None
        self.stopped = False  # the callback has asked for it
        self._bar: Any = None
        self._tell = self._teller(progress)
        self.control = Handle("control", "create_control")
        function = ProgressFunction(self._on_progress)
        self.struct = Watch(progress=function, control=self.control.value)
        self._kept = function

    def _teller(self, progress: Progress) -> Callable[[str, float], bool | None] | None:
        if progress is None or progress is False:
            return None
        if progress is not True:
            return progress
        try:
            from tqdm.auto import tqdm
        except ImportError:
            return None
        bar = self._bar = tqdm(total=100, unit="%", leave=False)

        def tell(stage: str, overall: float) -> None:
            bar.set_description(stage)
            if overall >= 0:
                bar.update(round(100 * overall, 1) - bar.n)

        return tell

    def _on_progress(self, _user: Any, stage: bytes, overall: float) -> int:
        try:
            if self._tell is not None and self._tell(stage.decode(), overall) is False:
                self.stopped = True
                return 1
            return 0
        except BaseException as error:  # KeyboardInterrupt, too
            self.raised = error
            return 1

    def keep(self, error: BaseException) -> None:
        """What another callback of the same work raised."""
        if self.raised is None:
            self.raised = error

    def run(self, work: Callable[[Any], None]) -> None:
        """work(watch), with its callbacks' exceptions passed on."""
        try:
            with _interrupts.cancel(self.control):
                work(C.byref(self.struct))
        except Exception as error:
            if isinstance(self.raised or error, Cancelled) and not self.stopped:
                # Ctrl-C came when a callback had begun, and before it could catch anything.
                raise KeyboardInterrupt from None
            if self.raised is not None:
                raise self.raised from None
            raise  # kept in no variable: what it refers to is free at once
        finally:
            if self._bar is not None:
                self._bar.close()
        if self.raised is not None:
            raise self.raised
