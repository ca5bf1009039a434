# SPDX-License-Identifier: Apache-2.0
"""Work that takes long: progress, and Ctrl-C, while the library runs without the GIL."""
from __future__ import annotations

import ctypes as C
import os
import signal
import threading
from typing import Any, Callable, Iterator, Optional, Union
from contextlib import contextmanager

from ._library import Handle, ProgressFunction, Watch, ask

#: Called with what is done now and 0..1 (negative: nobody knows); False stops the work. True: a
#: progress bar by tqdm, when it is installed.
Progress = Union[bool, Callable[[str, float], Optional[bool]], None]


class _Interrupts:
    """Cancels what the main thread waits for when Ctrl-C arrives. Python's own handler runs when the
    library has returned: so a thread reads the byte that Python writes at once for each signal."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._controls: list[Handle] = []
        self._pid = 0
        self._read = self._write = -1
        self._before = -1

    def _start(self) -> None:
        self._pid = os.getpid()
        self._lock = threading.Lock()
        self._controls = []
        self._read, self._write = os.pipe()
        os.set_blocking(self._write, False)
        threading.Thread(target=self._listen, args=(self._read,), daemon=True).start()

    def _listen(self, read: int) -> None:
        while True:
            numbers = os.read(read, 64)
            with self._lock:
                if signal.SIGINT in numbers:
                    for control in self._controls:
                        ask("cancel", control)
                before = self._before
            if before >= 0:
                try:
                    os.write(before, numbers)
                except OSError:
                    pass

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
        with self._lock:
            self._controls.append(control)
        before = signal.set_wakeup_fd(self._write, warn_on_full_buffer=False)
        if before != self._write:
            self._before = before
        try:
            yield
        finally:
            signal.set_wakeup_fd(before)
            with self._lock:
                self._controls.remove(control)


_interrupts = _Interrupts()


@contextmanager
def interruptible() -> Iterator[Handle]:
    """A control that Ctrl-C cancels."""
    control = Handle("control", "create_control")
    with _interrupts.cancel(control):
        yield control


class Watched:
    """An mtdb_watch, and what its callback raised."""

    def __init__(self, progress: Progress) -> None:
        self.raised: BaseException | None = None
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
        except Exception:
            if self.raised is not None:
                raise self.raised from None
            raise
        finally:
            if self._bar is not None:
                self._bar.close()
        if self.raised is not None:
            raise self.raised
