"""A walk in progress for whoever watches: its lines on a port, and a page that draws them.

====================== =========================================================================================
`process`              the process that serves both, and what the walk hands to it
`loop`                 sockets of this machine, served by an asyncio loop in a thread of its own
`line_server`          JSON lines for programs: each as it is made
`page_server`          the page for people: files over HTTP, messages over a websocket
`history`              the path as it is known now, thinned: what a page that opens late is sent first
`page/`                index.html, style.css, view.js: no build step, nothing from elsewhere
====================== =========================================================================================

Nothing that a listener does holds the walk up: what is sent goes to another process, which writes into the buffers
of the sockets. A listener of lines whose buffer is full is disconnected; a page's is left to drain, and gets the
whole path then.
"""
