//! Configuration files of every kind, as they stand in the repository, and parameter files of ROS 2.
#![no_main]
use sidehill::{check::check, config::ConfigFile};
use sidehill_bridge::ros2::names::NodeName;
use sidehill_fuzz::{repository, target};
use sidehill_ros2::node::parameter_file::ParameterFile;

target!(|data| {
    let Ok(text) = std::str::from_utf8(data) else {
        return;
    };
    // Names in a file are relative to it.
    let bridge = ["database:", "port:"].iter().any(|key| text.contains(key));
    let folder = repository(if bridge {
        "config/bridge"
    } else {
        "config/scenarios"
    });
    let file = ConfigFile::with_text(&folder.join("fuzz.yaml"), text.to_owned());
    let node = NodeName::new("/field", "sidehill");
    let _ = file
        .parse::<ParameterFile>()
        .map(|parameters| node.map(|node| parameters.for_node(&node).len()));
    let _ = check(file);
});
