//! What was driven, on earth: GeoJSON and KML.

use super::facts::DriveFacts;
use super::input::DecodedRecording;
use super::place::PlaceInTime;
use crate::report::figures::fixed;
use anyhow::{Context, Result};
use geojson::{Feature, FeatureCollection, GeometryValue, JsonObject};
use kml::types::{Coord, Geometry, LineString, Placemark, Point};
use kml::{Kml, KmlDocument, KmlVersion, KmlWriter};
use sidehill_controller::path::Point2;

/// Least distance between two points of a track, m.
const STEP_M: f64 = 0.1;
/// Time without a pose that parts a track, s.
const GAP_S: f64 = 2.0;

/// Longitude and latitude, deg.
type Position = [f64; 2];

/// What was driven, on earth.
pub(super) struct Track {
    name: String,
    lines: Vec<Vec<Position>>,
    places: Vec<NamedPlace>,
}

/// A stop or a worst place.
struct NamedPlace {
    kind: &'static str,
    text: String,
    after_s: f64,
    at: Position,
}

/// Returns what was driven, with stops and worst places.
///
/// # Errors
/// A recording without a place on earth.
pub(super) fn track(input: &DecodedRecording, facts: &DriveFacts) -> Result<Track> {
    let datum = input.place_on_earth()?;
    let mut lines: Vec<Vec<Position>> = Vec::new();
    let mut last: Option<(f64, Point2)> = None;
    for (time_s, step) in &input.steps {
        let at = Point2 {
            x_m: step.estimated_x_m,
            y_m: step.estimated_y_m,
        };
        if !(at.x_m.is_finite() && at.y_m.is_finite()) {
            continue;
        }
        let parted = last.is_none_or(|(last_s, _)| time_s - last_s > GAP_S);
        let moved =
            last.is_none_or(|(_, from)| (at.x_m - from.x_m).hypot(at.y_m - from.y_m) >= STEP_M);
        let (latitude_deg, longitude_deg) = match parted || moved {
            true => datum.unproject(at),
            false => {
                last = last.map(|(_, from)| (*time_s, from));
                continue;
            }
        };
        if parted {
            lines.push(Vec::new());
        }
        if let Some(line) = lines.last_mut() {
            line.push([longitude_deg, latitude_deg]);
        }
        last = Some((*time_s, at));
    }
    lines.retain(|line| line.len() > 1);
    let stops = facts
        .stops
        .iter()
        .map(|stop| ("stop", stop.cause.clone(), stop.place));
    let worst = facts.worst.iter();
    let worst = worst.map(|worst| {
        (
            "worst place",
            format!("cross-track error {} m", fixed(worst.cross_track_m, 3)),
            worst.place,
        )
    });
    let named = |(kind, text, place): (_, _, PlaceInTime)| {
        Some(NamedPlace {
            kind,
            text,
            after_s: place.after_s,
            at: [place.longitude_deg?, place.latitude_deg?],
        })
    };
    Ok(Track {
        name: input.name.clone(),
        lines,
        places: stops.chain(worst).filter_map(named).collect(),
    })
}

impl Track {
    /// Returns the track as GeoJSON (RFC 7946).
    pub(super) fn geojson(&self) -> String {
        let lines = GeometryValue::new_multi_line_string(
            self.lines.iter().map(|line| line.iter().copied()),
        );
        let feature = |geometry: GeometryValue, properties: JsonObject| Feature {
            properties: Some(properties),
            ..Feature::from(geometry)
        };
        let object = |entries: &[(&str, serde_json::Value)]| -> JsonObject {
            entries
                .iter()
                .map(|(key, value)| ((*key).to_owned(), value.clone()))
                .collect()
        };
        let driven = object(&[
            ("kind", "driven".into()),
            ("name", self.name.clone().into()),
        ]);
        let mut features = vec![feature(lines, driven)];
        for place in &self.places {
            let properties = object(&[
                ("kind", place.kind.into()),
                ("name", place.text.clone().into()),
                ("after_s", place.after_s.into()),
            ]);
            features.push(feature(GeometryValue::new_point(place.at), properties));
        }
        FeatureCollection::new(features).to_string() + "\n"
    }

    /// Returns the track as KML 2.2.
    ///
    /// # Errors
    /// One of the writer.
    pub(super) fn kml(&self) -> Result<Vec<u8>> {
        let coord = |[longitude_deg, latitude_deg]: &Position| {
            Coord::new(*longitude_deg, *latitude_deg, None)
        };
        let mark = |name: String, description: Option<String>, geometry| {
            Kml::Placemark(Placemark {
                name: Some(name),
                description,
                geometry: Some(geometry),
                ..Placemark::default()
            })
        };
        let lines = self.lines.iter().map(|line| {
            let line = LineString {
                tessellate: true,
                ..LineString::from(line.iter().map(coord).collect::<Vec<_>>())
            };
            mark(
                "driven".to_owned(),
                Some(self.name.clone()),
                Geometry::LineString(line),
            )
        });
        let places = self.places.iter().map(|place| {
            let text = format!("{} after {:.1} s", place.text, place.after_s);
            mark(
                place.kind.to_owned(),
                Some(text),
                Geometry::Point(Point::from(coord(&place.at))),
            )
        });
        let document = Kml::KmlDocument(KmlDocument {
            version: KmlVersion::V22,
            attrs: [(
                "xmlns".to_owned(),
                "http://www.opengis.net/kml/2.2".to_owned(),
            )]
            .into(),
            elements: vec![Kml::Document {
                attrs: Default::default(),
                elements: lines.chain(places).collect(),
            }],
        });
        let mut bytes = b"<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n".to_vec();
        KmlWriter::from_writer(&mut bytes)
            .write(&document)
            .context("KML cannot be written")?;
        Ok(bytes)
    }
}
