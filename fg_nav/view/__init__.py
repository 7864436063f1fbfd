"""A walk in progress for spectators: its lines on a port, and a page that draws them.

====================== =========================================================================================
`process`              the process that serves both, and its interface to the walk
`line_server`          sockets of this machine, and the server of JSON lines
`page_server`          the page: files over HTTP, messages over a websocket
`history`              the current paths, thinned: the first message to a page that opens late
`page/`                index.html, style.css, view.js: no build step, no external resources
====================== =========================================================================================

No client can delay the walk: messages go to another process, which writes into the buffers of the sockets. A client of
lines whose buffer is full is disconnected; a page's is left to drain, and then gets the whole path.
"""
