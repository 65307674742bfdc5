"""Builds the documentation from the repository alone: `make docs`, or `python -m docs.site`.

gather.py        copies every page, and what pages link to, into one folder; links are made to fit
links.py         where a link of a page leads, in the repository and on the site
generate.py      pages made from the sources: commands, decisions, architecture, licences
mathematics.py   formulas become MathML while a page is rendered, so that no script is needed
check.py         looks at the built pages: dead links and pictures, orphans, anything fetched from elsewhere

Pages are rendered by Zensical (decision 100). Links are written as they hold in the repository.
"""
