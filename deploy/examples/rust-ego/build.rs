//! Messages from the schema that tailroad itself is built from; protox needs no protoc on the machine.

use std::path::PathBuf;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let root = PathBuf::from(std::env::var("CARGO_MANIFEST_DIR")?).join("../../..");
    let schema = root.join("service/world/egos/ego.proto");
    println!("cargo:rerun-if-changed={}", schema.display());
    let descriptors = protox::compile(["service/world/egos/ego.proto"], [&root])?;
    prost_build::Config::new().compile_fds(descriptors)?;
    Ok(())
}
