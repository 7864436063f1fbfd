"""A server of the view in a loop of its own thread, as it is in its own process."""

import asyncio
import threading
from functools import partial

LOOP = asyncio.new_event_loop()
threading.Thread(target=LOOP.run_forever, name="served", daemon=True).start()


class Served:
    """A server on a socket; what it is told to send it is told in its loop."""

    def __init__(self, server, door):
        self.server, self.port = server, door.getsockname()[1]
        LOOP.set_exception_handler(lambda loop, context: None)
        asyncio.run_coroutine_threadsafe(server.open(door), LOOP).result()

    def __getattr__(self, name):
        found = getattr(self.server, name)
        return partial(LOOP.call_soon_threadsafe, found) if name.startswith("send") else found

    def close(self):
        asyncio.run_coroutine_threadsafe(self.server.close(), LOOP).result()
