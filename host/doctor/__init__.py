"""What ``rotdrift doctor`` looks at: the machine, and a link."""
