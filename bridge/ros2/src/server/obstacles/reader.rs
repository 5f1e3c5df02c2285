//! The subscription to a costmap.

use super::costmap::{Costmap, CostmapError};
use super::{Doubt, ObstacleSettings, Surroundings};
use crate::node::subscription::{take_all, take_newest};
use crate::node::time::RosTime;
use crate::node::{NodeError, RosNode, qos};
use ros2_client::Subscription;
use ros2_client::dds::rustdds::mio1::{Interest, Registry, Token};
use sidehill_bridge::ros2::message::{
    self, CostmapUpdate, OccupancyGrid, OccupancyGridUpdate, TopicMessage,
};
use sidehill_bridge::ros2::settings::costmap::{CostmapConfig, CostmapKind};
use sidehill_bridge::ros2::transforms::Transforms;

/// A map and its updates.
struct Pair<M: 'static, U: 'static> {
    map: Subscription<M>,
    updates: Subscription<U>,
}

impl<M, U> Pair<M, U>
where
    M: TopicMessage + serde::de::DeserializeOwned + 'static,
    U: TopicMessage + serde::de::DeserializeOwned + 'static,
{
    fn new(
        node: &mut RosNode,
        topic: &str,
        (registry, token): (&Registry, Token),
    ) -> Result<Self, NodeError> {
        let mut pair = Self {
            map: node.subscription(topic, &qos::LATCHED)?,
            updates: node.subscription(&format!("{topic}_updates"), &qos::RELIABLE_10)?,
        };
        registry.register(&mut pair.map, token, Interest::READABLE)?;
        registry.register(&mut pair.updates, token, Interest::READABLE)?;
        Ok(pair)
    }

    /// Takes the newest map, then the updates that have arrived.
    fn read(
        &self,
        costmap: &mut Option<Costmap>,
        convert: impl Fn(M) -> Result<Costmap, CostmapError>,
        update: fn(&mut Costmap, U) -> Result<(), CostmapError>,
        mut reject: impl FnMut(CostmapError),
    ) {
        if let Some(map) = take_newest(&self.map) {
            match convert(map) {
                Ok(map) => *costmap = Some(map),
                Err(error) => reject(error),
            }
        }
        take_all(&self.updates, |message, _| {
            let taken = match costmap {
                Some(costmap) => update(costmap, message),
                None => Err(CostmapError::Update),
            };
            if let Err(error) = taken {
                reject(error);
            }
        });
    }
}

enum Topics {
    Grid(Pair<OccupancyGrid, OccupancyGridUpdate>),
    Costmap(Pair<message::Costmap, CostmapUpdate>),
}

/// Subscribes to a costmap, and holds the newest.
pub(crate) struct CostmapReader {
    topics: Topics,
    settings: ObstacleSettings,
    costmap: Option<Costmap>,
}

impl CostmapReader {
    /// Subscribes.
    pub(crate) fn new(
        node: &mut RosNode,
        settings: ObstacleSettings,
        events: (&Registry, Token),
    ) -> Result<Self, NodeError> {
        let CostmapConfig { topic, kind, .. } = &settings.config;
        let topics = match kind {
            CostmapKind::OccupancyGrid => Topics::Grid(Pair::new(node, topic, events)?),
            CostmapKind::Costmap => Topics::Costmap(Pair::new(node, topic, events)?),
        };
        Ok(Self {
            topics,
            settings,
            costmap: None,
        })
    }

    /// Returns the settings of the check.
    pub(crate) fn settings(&self) -> &ObstacleSettings {
        &self.settings
    }

    /// Takes what has arrived; `reject` gets the messages that cannot be used.
    pub(crate) fn read(&mut self, mut reject: impl FnMut(&str, &CostmapError)) {
        let topic = &self.settings.config.topic;
        let reject = |error: CostmapError| reject(topic, &error);
        let (map, rule) = (&mut self.costmap, self.settings.rule());
        match &self.topics {
            Topics::Grid(pair) => {
                let convert = |grid| Costmap::from_grid(grid, rule);
                pair.read(map, convert, Costmap::update_grid, reject);
            }
            Topics::Costmap(pair) => {
                let convert = |message| Costmap::from_costmap(message, rule);
                pair.read(map, convert, Costmap::update_costmap, reject);
            }
        }
    }

    /// Returns what is known at `now_s`.
    pub(crate) fn surroundings(
        &self,
        now_s: f64,
        time: &RosTime,
        frames: (&Transforms, &str, f64),
    ) -> Result<Surroundings<'_>, Doubt> {
        let costmap = self.costmap.as_ref().ok_or(Doubt::NoCostmap)?;
        let stamp_s = time.local_s(costmap.stamp_ns);
        Surroundings::new(costmap, (stamp_s, now_s), frames, &self.settings)
    }
}
