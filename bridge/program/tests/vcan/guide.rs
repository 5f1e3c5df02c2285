//! The guide's commands that need a bus.

use crate::guide_blocks::blocks_of;
use crate::support::Folder;

#[test]
#[ignore = "needs a CAN bus: run .ci/vcan"]
fn the_guides_commands_for_a_bus_run() {
    let folder = Folder::new("guide");
    let blocks = blocks_of("connect_can.md");
    let writes = |script: &str| script.contains("sidehill init");
    let needed = blocks
        .iter()
        .filter(|block| block.needs == "can" || writes(&block.script));
    let mut count = 0;
    for block in needed {
        block.succeed(&folder.0);
        count += 1;
    }
    assert_eq!(count, 2);
}
