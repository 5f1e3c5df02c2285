//! Settings of the obstacle check.

use serde::{Deserialize, Serialize};
use sidehill_plant::bounds::Bounds;
use sidehill_plant::vehicle::RangeError;

/// Message type of a costmap.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum CostmapKind {
    /// nav_msgs/OccupancyGrid, with updates as map_msgs/OccupancyGridUpdate.
    #[default]
    OccupancyGrid,
    /// nav2_msgs/Costmap, with updates as nav2_msgs/CostmapUpdate.
    Costmap,
}

/// The `costmap:` part of `ros2:`: which cells stop the vehicle, and where.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct CostmapConfig {
    /// Topic of the costmap, transient local. Updates come on the same name with `_updates`.
    pub topic: String,
    /// nav_msgs/OccupancyGrid with map_msgs/OccupancyGridUpdate, or nav2_msgs/Costmap with nav2_msgs/CostmapUpdate.
    pub kind: CostmapKind,
    /// Corners [x, y] of the vehicle, m, in `frames.base`, x forward and y left, at least three. None: the base
    /// rectangle of the vehicle, which is that of the wheel contacts.
    pub footprint: Vec<[f64; 2]>,
    /// Added to the footprint on all sides.
    pub footprint_padding_m: f64,
    /// Gap along the path to the obstacle at which the vehicle stands.
    pub margin_m: f64,
    /// Smallest cost of an obstacle, on the scale of OccupancyGrid: 100 is lethal, 99 inscribed.
    pub lethal_cost: i8,
    /// Whether cells without information are obstacles.
    pub unknown_is_lethal: bool,
    /// Friction coefficient of the ground that braking relies on.
    pub friction: f64,
    /// Largest age of a costmap.
    pub timeout_s: f64,
    /// Longest wait for a free way or a fresh costmap.
    pub patience_s: f64,
    /// Farthest from the path that the vehicle goes to pass an obstacle. 0: it stops for all.
    pub corridor_m: f64,
}

impl Default for CostmapConfig {
    fn default() -> Self {
        Self {
            topic: "local_costmap/costmap".to_owned(),
            kind: CostmapKind::default(),
            footprint: Vec::new(),
            footprint_padding_m: 0.1,
            margin_m: 0.3,
            lethal_cost: 100,
            unknown_is_lethal: false,
            friction: 0.5,
            timeout_s: 1.0,
            patience_s: 10.0,
            corridor_m: 0.0,
        }
    }
}

impl CostmapConfig {
    /// Checks the ranges.
    ///
    /// # Errors
    /// [`RangeError`] with the first key out of its range.
    pub fn validate(&self) -> Result<(), RangeError> {
        if !self.footprint.is_empty() {
            let corners = self.footprint.len() as f64;
            Bounds::new(3.0, 64.0, "corners").check("ros2.costmap.footprint", corners)?;
        }
        for corner in self.footprint.iter().flatten() {
            Bounds::new(-20.0, 20.0, "m").check("ros2.costmap.footprint", *corner)?;
        }
        let padding_m = self.footprint_padding_m;
        Bounds::new(0.0, 2.0, "m").check("ros2.costmap.footprint_padding_m", padding_m)?;
        Bounds::new(0.05, 5.0, "m").check("ros2.costmap.margin_m", self.margin_m)?;
        let lethal = f64::from(self.lethal_cost);
        Bounds::new(1.0, 100.0, "").check("ros2.costmap.lethal_cost", lethal)?;
        Bounds::new(0.1, 2.0, "").check("ros2.costmap.friction", self.friction)?;
        Bounds::new(0.1, 10.0, "s").check("ros2.costmap.timeout_s", self.timeout_s)?;
        Bounds::new(0.0, 3600.0, "s").check("ros2.costmap.patience_s", self.patience_s)?;
        Bounds::new(0.0, 5.0, "m").check("ros2.costmap.corridor_m", self.corridor_m)?;
        Ok(())
    }
}
