"""A walk in progress for spectators: its lines on a port, and a page that draws them (docs/online.md).

`outlets` has where lines and remarks go, and the interface to the process that serves them, which is `servers`, so that
no client can delay the walk; `history` has the current paths for a page that opens late. `board` shows several walks on
one page, `plan` a picture under them. `page/` is plain HTML and JavaScript: no build step, no external resources.
"""
