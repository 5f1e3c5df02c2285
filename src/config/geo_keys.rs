//! What the keys of a GeoTIFF say of its units (GeoTIFF 1.1).

use std::ops::RangeInclusive;
use tiff::TiffResult;

const MODEL_TYPE: u16 = 1024;
/// Latitude and longitude; the others are a projection, or none that is known.
const GEOGRAPHIC: u16 = 2;
const GEOCENTRIC: u16 = 3;
const RASTER_TYPE: u16 = 1025;
const POINTS: u16 = 2;
const NAME: u16 = 1026;
const GEODETIC: u16 = 2048;
const PROJECTED: u16 = 3072;
const PROJECTED_NAME: u16 = 3073;
const LINEAR_UNIT: u16 = 3076;
const LINEAR_UNIT_SIZE: u16 = 3077;
const VERTICAL: u16 = 4096;
const VERTICAL_UNIT: u16 = 4099;
/// Units by their numbers in the registry of the EPSG.
const METRE: u16 = 9001;
const USER_DEFINED: u16 = 32767;

/// Systems of the EPSG, version 12, that are in feet: those with neighbouring numbers. Most others say (ft) or (ftUS) in
/// their names.
const PROJECTED_IN_FEET: [RangeInclusive<u16>; 23] = [
    2222..=2289,
    2867..=2930,
    2964..=2968,
    3417..=3438,
    3441..=3446,
    3451..=3459,
    3560..=3570,
    3728..=3739,
    3753..=3760,
    4399..=4413,
    4418..=4433,
    4438..=4457,
    6128..=6202,
    7057..=7070,
    7119..=7128,
    7587..=7645,
    8518..=8540,
    23301..=23333,
    24370..=24374,
    26729..=26813,
    26847..=26870,
    32001..=32058,
    32064..=32077,
];
/// All systems of heights in feet.
const HEIGHTS_IN_FEET: [RangeInclusive<u16>; 7] = [
    5614..=5614,
    5702..=5702,
    5754..=5754,
    6130..=6132,
    6358..=6360,
    8050..=8053,
    8228..=8228,
];

/// The three tags that hold the keys, as far as a file has them.
pub(super) struct GeoKeys {
    /// A header of four numbers, then for each key its number, place, count and value.
    pub(super) directory: TiffResult<Vec<u16>>,
    /// Values that are not whole.
    pub(super) numbers: TiffResult<Vec<f64>>,
    /// Texts, one after the other.
    pub(super) texts: TiffResult<String>,
}

impl GeoKeys {
    /// Returns whether places are not in degrees, nor from the centre of the earth.
    pub(super) fn is_flat(&self) -> bool {
        let model = self.value(MODEL_TYPE);
        let model = model.or(self.value(GEODETIC).map(|_| GEOGRAPHIC));
        !matches!(model, Some(GEOGRAPHIC | GEOCENTRIC))
    }

    /// Returns whether a height is of a point, not of the area of a cell.
    pub(super) fn are_points(&self) -> bool {
        self.value(RASTER_TYPE) == Some(POINTS)
    }

    /// Returns the unit of places where it is not the metre.
    pub(super) fn unit_of_places(&self) -> Option<String> {
        let size_m = self.value(LINEAR_UNIT_SIZE);
        let size_m = size_m.and_then(|at| self.numbers.as_ref().ok()?.get(usize::from(at)));
        match (self.value(LINEAR_UNIT), size_m) {
            (Some(METRE), _) => None,
            (Some(USER_DEFINED), Some(&size_m)) => {
                (size_m != 1.0).then(|| format!("of {size_m} m"))
            }
            (Some(USER_DEFINED) | None, _) => self.feet(0, PROJECTED, &PROJECTED_IN_FEET),
            (Some(unit), _) => Some(format!("EPSG:{unit}, as feet are")),
        }
    }

    /// Returns the unit of heights where it is not the metre.
    pub(super) fn unit_of_heights(&self) -> Option<String> {
        match self.value(VERTICAL_UNIT) {
            Some(METRE) => None,
            Some(USER_DEFINED) | None => self.feet(1, VERTICAL, &HEIGHTS_IN_FEET),
            Some(unit) => Some(format!("EPSG:{unit}")),
        }
    }

    /// Returns which system is in feet, by its name, as GDAL writes it of both systems at once, or by its number.
    fn feet(&self, part: usize, key: u16, systems: &[RangeInclusive<u16>]) -> Option<String> {
        let mut names = [NAME, PROJECTED_NAME].into_iter().filter_map(|key| {
            let name = self.text(key)?.split(" + ").nth(part)?;
            Some(name.trim_end_matches('|'))
        });
        if let Some(name) = names.find(|name| name.contains("(ft")) {
            return Some(format!("of {name}"));
        }
        let system = self.value(key)?;
        let is_known = systems.iter().any(|range| range.contains(&system));
        is_known.then(|| format!("of EPSG:{system}, the foot"))
    }

    fn entry(&self, key: u16) -> Option<&[u16]> {
        let entries = self.directory.as_ref().ok()?.chunks_exact(4);
        entries.skip(1).find(|entry| entry[0] == key)
    }

    fn value(&self, key: u16) -> Option<u16> {
        Some(self.entry(key)?[3])
    }

    fn text(&self, key: u16) -> Option<&str> {
        let entry = self.entry(key)?;
        let text = self.texts.as_ref().ok()?.get(usize::from(entry[3])..)?;
        text.get(..usize::from(entry[2]))
    }
}
