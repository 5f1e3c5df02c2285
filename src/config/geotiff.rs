//! Elevation grids in GeoTIFF, as the text of an ESRI ASCII grid.

use super::geo_keys::GeoKeys;
use std::fmt::Write;
use std::io::Cursor;
use tiff::ColorType;
use tiff::decoder::{Decoder, DecodingResult, Limits};
use tiff::tags::Tag;

/// Most bytes of the heights: 16 million of double precision.
const HEIGHTS_MAX: usize = 128_000_000;
/// Where GDAL keeps scale, offset and unit of the heights, as XML.
const GDAL_METADATA: Tag = Tag::Unknown(42112);

/// Returns the text of the grid in a file with one band of heights.
///
/// # Errors
/// What the grid lacks, with the command of GDAL that mends it.
pub(super) fn to_esri(bytes: &[u8]) -> Result<String, String> {
    let failed = |error: tiff::TiffError| {
        format!(
            "not readable as GeoTIFF: {error}; if GDAL reads it, `gdal_translate -ot Float32 -co COMPRESS=DEFLATE FILE \
             OUT.tif` writes a usual one"
        )
    };
    let mut limits = Limits::default();
    limits.decoding_buffer_size = HEIGHTS_MAX;
    limits.intermediate_buffer_size = HEIGHTS_MAX;
    let decoder = Decoder::new(Cursor::new(bytes)).map_err(failed)?;
    let mut decoder = decoder.with_limits(limits);
    if !matches!(decoder.colortype().map_err(failed)?, ColorType::Gray(_)) {
        return Err(
            "has several bands or colours, must have one of heights in m; `gdal_translate -b 1 FILE OUT` takes the first"
                .to_owned(),
        );
    }
    let keys = GeoKeys {
        directory: decoder.get_tag_u16_vec(Tag::GeoKeyDirectoryTag),
        numbers: decoder.get_tag_f64_vec(Tag::GeoDoubleParamsTag),
        texts: decoder.get_tag_ascii_string(Tag::GeoAsciiParamsTag),
    };
    if !keys.is_flat() {
        return Err(
            "its places are in degrees or from the centre of the earth, must be in m; `gdalwarp -t_srs EPSG:... FILE OUT` \
             projects it, as to UTM"
                .to_owned(),
        );
    }
    if let Some(unit) = keys.unit_of_places() {
        return Err(format!(
            "its places are in the unit {unit}, must be in m; `gdalwarp -t_srs EPSG:... FILE OUT` projects it, as to UTM"
        ));
    }
    let metadata = decoder.get_tag_ascii_string(GDAL_METADATA).ok();
    let metadata = metadata.unwrap_or_default();
    let item = |role: &str| {
        let (_, rest) = metadata.split_once(&format!("role=\"{role}\""))?;
        let (_, rest) = rest.split_once('>')?;
        rest.split('<').next().map(str::trim)
    };
    let metres = ["", "m", "metre", "metres", "meter", "meters"];
    let unit = item("unittype").filter(|unit| !metres.contains(&unit.to_lowercase().as_str()));
    let unit = unit.map(str::to_owned);
    if let Some(unit) = unit.or_else(|| keys.unit_of_heights()) {
        return Err(format!(
            "its heights are in the unit {unit}, must be in m; for feet `gdal_calc.py -A FILE --calc='0.3048*A' \
             --type=Float32 --outfile=OUT.tif` converts them"
        ));
    }
    let is = |role, number: f64| item(role).is_none_or(|text| text.parse() == Ok(number));
    if !is("scale", 1.0) || !is("offset", 0.0) {
        return Err(
            "its heights have a scale or an offset; `gdal_translate -unscale -ot Float32 FILE OUT.tif` applies them"
                .to_owned(),
        );
    }
    let scale = decoder.get_tag_f64_vec(Tag::ModelPixelScaleTag).ok();
    let tie = decoder.get_tag_f64_vec(Tag::ModelTiepointTag).ok();
    let (Some(&[dx_m, dy_m, ..]), Some(&[column, row, _, x_m, y_m, _])) =
        (scale.as_deref(), tie.as_deref())
    else {
        return Err(
            "does not say where it is by the size of its cells and one place, as a GeoTIFF with north up does; \
             `gdalwarp FILE OUT` writes it so"
                .to_owned(),
        );
    };
    let (columns, rows) = decoder.dimensions().map_err(failed)?;
    let nodata = decoder.get_tag_ascii_string(Tag::GdalNodata).ok();
    let nodata = nodata.map(|text| text.trim_matches(['\0', ' ']).to_owned());
    let nodata = nodata.filter(|text| !text.is_empty());
    if let Some(text) = nodata.as_ref().filter(|text| text.parse::<f64>().is_err()) {
        return Err(format!(
            "its NODATA value {text:?} is no number; `gdal_edit.py -a_nodata -9999 FILE` sets one"
        ));
    }
    let (place, below) = if keys.are_points() {
        ("center", f64::from(rows) - 1.0)
    } else {
        ("corner", f64::from(rows))
    };
    let west_m = x_m - column * dx_m;
    let south_m = y_m + row * dy_m - below * dy_m;
    let mut out = format!(
        "ncols {columns}\nnrows {rows}\nxll{place} {west_m}\nyll{place} {south_m}\ndx {dx_m}\ndy {dy_m}\n"
    );
    if let Some(nodata) = nodata {
        let _ = writeln!(out, "NODATA_value {nodata}");
    }
    match decoder.read_image().map_err(failed)? {
        DecodingResult::U8(heights) => write_rows(&mut out, columns, heights),
        DecodingResult::U16(heights) => write_rows(&mut out, columns, heights),
        DecodingResult::U32(heights) => write_rows(&mut out, columns, heights),
        DecodingResult::I8(heights) => write_rows(&mut out, columns, heights),
        DecodingResult::I16(heights) => write_rows(&mut out, columns, heights),
        DecodingResult::I32(heights) => write_rows(&mut out, columns, heights),
        DecodingResult::F32(heights) => write_rows(&mut out, columns, heights),
        DecodingResult::F64(heights) => write_rows(&mut out, columns, heights),
        _ => {
            return Err(
                "its heights are numbers of an unusual kind; `gdal_translate -ot Float32 FILE OUT` writes usual ones"
                    .to_owned(),
            );
        }
    }
    Ok(out)
}

/// Writes heights row by row; values that are no heights are short in this form, too.
fn write_rows<T: std::fmt::LowerExp>(out: &mut String, columns: u32, heights: Vec<T>) {
    for row in heights.chunks((columns as usize).max(1)) {
        for height in row {
            let _ = write!(out, "{height:e} ");
        }
        out.push('\n');
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use sidehill_plant::terrain::GridTerrain;
    use tiff::encoder::{TiffEncoder, colortype};

    /// A grid of 3 by 2 cells of 2 m, whose northwest corner is at 100, 50.
    fn written(heights: &[f32], keys: &[u16], nodata: &str) -> Vec<u8> {
        with_metadata(heights, keys, nodata, "")
    }

    fn with_metadata(heights: &[f32], keys: &[u16], nodata: &str, metadata: &str) -> Vec<u8> {
        let mut bytes = Cursor::new(Vec::new());
        let mut encoder = TiffEncoder::new(&mut bytes).unwrap();
        let mut image = encoder.new_image::<colortype::Gray32Float>(3, 2).unwrap();
        let tags = image.encoder();
        tags.write_tag(Tag::ModelPixelScaleTag, &[2.0, 2.0, 0.0][..])
            .unwrap();
        tags.write_tag(
            Tag::ModelTiepointTag,
            &[0.0, 0.0, 0.0, 100.0, 50.0, 0.0][..],
        )
        .unwrap();
        tags.write_tag(Tag::GeoKeyDirectoryTag, keys).unwrap();
        tags.write_tag(Tag::GeoDoubleParamsTag, &[0.3048, 1.0][..])
            .unwrap();
        tags.write_tag(Tag::GeoAsciiParamsTag, NAMES).unwrap();
        tags.write_tag(Tag::GdalNodata, nodata).unwrap();
        tags.write_tag(GDAL_METADATA, metadata).unwrap();
        image.write_data(heights).unwrap();
        bytes.into_inner()
    }

    /// The names of systems that keys of a file may be, each with its end.
    const NAMES: &str = "NAD83 / Maine East (ftUS)|A / B + C height (ft)|A / B + C height|";
    const HEIGHTS: [f32; 6] = [1.5, 2.0, 3.0, 4.0, 5.0, f32::MIN];
    const PROJECTED: [u16; 8] = [1, 1, 0, 1, 1024, 0, 1, 1];

    #[test]
    fn a_geotiff_is_the_grid_that_its_tags_place() {
        let bytes = written(&HEIGHTS, &PROJECTED, "-3.4028234663852886e+38");
        let grid = GridTerrain::parse(&to_esri(&bytes).unwrap()).unwrap();
        let extent = grid.extent();
        assert_eq!((extent.west_m, extent.east_m), (101.0, 105.0));
        assert_eq!((extent.south_m, extent.north_m), (47.0, 49.0));
        assert_eq!(grid.cell_at(101.0, 49.0), (1, 1));
        // Places of points, not of areas.
        let points = [&PROJECTED[..], &[1025, 0, 1, 2]].concat();
        let bytes = written(&HEIGHTS, &points, "-3.4028234663852886e+38");
        let extent = GridTerrain::parse(&to_esri(&bytes).unwrap())
            .unwrap()
            .extent();
        assert_eq!((extent.west_m, extent.north_m), (100.0, 50.0));
        // A void that is not declared is found as in a text.
        let bytes = written(&HEIGHTS, &PROJECTED, "-1");
        let error = GridTerrain::parse(&to_esri(&bytes).unwrap()).unwrap_err();
        assert!(error.to_string().contains("row 2, column 3"), "{error}");
    }

    #[test]
    fn heights_and_places_in_other_units_are_refused_with_the_remedy() {
        let keys = |more: &[u16]| [&PROJECTED[..], more].concat();
        for (keys, metadata, says) in [
            // Survey feet, international feet; latitude and longitude by their system alone.
            (keys(&[3076, 0, 1, 9003]), "", "EPSG:9003"),
            (
                keys(&[4099, 0, 1, 9002]),
                "",
                "heights are in the unit EPSG:9002",
            ),
            // A unit of its own, of 0.3048 m.
            (
                keys(&[3076, 0, 1, 32767, 3077, 34736, 1, 0]),
                "",
                "unit of 0.3048 m",
            ),
            // No unit, but a system: by its number, by its name.
            (keys(&[3072, 0, 1, 2229]), "", "of EPSG:2229, the foot"),
            (
                keys(&[3072, 0, 1, 26847, 1026, 34737, 26, 0]),
                "",
                "NAD83 / Maine East (ftUS)",
            ),
            (
                keys(&[3072, 0, 1, 6348, 4096, 0, 1, 6360]),
                "",
                "heights are in the unit of EPSG:6360",
            ),
            (
                keys(&[1026, 34737, 22, 26]),
                "",
                "heights are in the unit of C height (ft)",
            ),
            (vec![1, 1, 0, 1, 2048, 0, 1, 4326], "", "degrees"),
            (vec![1, 1, 0, 1, 1024, 0, 1, 3], "", "centre of the earth"),
            (
                keys(&[]),
                "<Item name=\"UNITTYPE\" sample=\"0\" role=\"unittype\">US survey foot</Item>",
                "US survey foot",
            ),
            (
                keys(&[]),
                "<GDALMetadata>\n<Item name=\"SCALE\" sample=\"0\" role=\"scale\">0.1</Item>\n</GDALMetadata>",
                "-unscale",
            ),
            (
                keys(&[]),
                "<Item name=\"OFFSET\" sample=\"0\" role=\"offset\">-500</Item>",
                "-unscale",
            ),
        ] {
            let error = to_esri(&with_metadata(&HEIGHTS, &keys, "-1", metadata)).unwrap_err();
            assert!(error.contains(says), "{error}");
        }
        let metres =
            "<Item name=\"SCALE\" role=\"scale\">1</Item><Item role=\"unittype\">metre</Item>";
        let keys = keys(&[3076, 0, 1, 9001, 4099, 0, 1, 9001]);
        assert!(to_esri(&with_metadata(&HEIGHTS, &keys, "-1", metres)).is_ok());
        for more in [
            &[3072, 0, 1, 2056, 4096, 0, 1, 5703, 1026, 34737, 17, 48][..],
            &[3076, 0, 1, 32767, 3077, 34736, 1, 1],
            // What a file says itself counts more than the name of its system, and ends of tags are kept.
            &[3076, 0, 1, 9001, 1026, 34737, 26, 0],
            &[1026, 34737, 9000, 9000, 3077, 34736, 1, 9000],
        ] {
            let keys = [&PROJECTED[..], more].concat();
            assert!(to_esri(&written(&HEIGHTS, &keys, "-1")).is_ok(), "{more:?}");
        }
        let error = to_esri(&written(&HEIGHTS, &PROJECTED, "none")).unwrap_err();
        assert!(error.contains("\"none\" is no number"), "{error}");
    }

    #[test]
    fn what_is_no_grid_in_metres_is_refused_with_the_remedy() {
        let degrees = [1, 1, 0, 1, 1024, 0, 1, 2];
        let error = to_esri(&written(&HEIGHTS, &degrees, "-1")).unwrap_err();
        assert!(
            error.contains("degrees") && error.contains("gdalwarp"),
            "{error}"
        );
        let mut bytes = Cursor::new(Vec::new());
        let mut encoder = TiffEncoder::new(&mut bytes).unwrap();
        encoder
            .write_image::<colortype::Gray8>(2, 2, &[1, 2, 3, 4])
            .unwrap();
        let error = to_esri(bytes.get_ref()).unwrap_err();
        assert!(error.contains("where it is"), "{error}");
        let mut bytes = Cursor::new(Vec::new());
        let mut encoder = TiffEncoder::new(&mut bytes).unwrap();
        encoder
            .write_image::<colortype::RGB8>(1, 1, &[1, 2, 3])
            .unwrap();
        let error = to_esri(bytes.get_ref()).unwrap_err();
        assert!(error.contains("gdal_translate -b 1"), "{error}");
        let whole = written(&HEIGHTS, &PROJECTED, "-1");
        for length in 0..whole.len() {
            // Cut off: refused, or what is missing was not needed.
            let _ = to_esri(&whole[..length]);
        }
        assert!(to_esri(&whole[..20]).unwrap_err().contains("not readable"));
    }
}
