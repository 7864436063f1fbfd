"""A walk in progress for spectators: its lines on a port, and a page that draws them.

====================== =========================================================================================
`outlets`              where lines and remarks go, and the interface to the process that serves them
`servers`              that process: JSON lines on a port; the page, files over HTTP and messages over a websocket
`history`              the current paths, thinned: the first message to a page that opens late
`page/`                index.html, style.css, view.js: no build step, no external resources
====================== =========================================================================================

No client can delay the walk: messages go to another process, which writes into the buffers of the sockets. A client of
lines whose buffer is full is disconnected; a page's is left to drain, and then gets the whole path.
"""
