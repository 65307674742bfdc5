//! Nothing: this package only pins the versions of the router and its plugin (see `build`).
