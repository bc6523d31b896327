"""The live side: links, capture, recording, dashboard and the `rotdrift` command."""
