//! The program `sidehill`.

fn main() {}
