"""REST and event streams over the daemon; the page and the client talk to it through this alone."""
