"""The documentation: pages, and in `site/` what builds them into a site (`make docs`)."""
