//! JSON schemas of a set, by which editors complete and check its files.

use super::file::File;

/// Folder of the schemas within that of a set.
pub(super) const SCHEMAS: &str = "schema";

/// JSON schemas for editors, by their names in a set.
const SCHEMA_FILES: [(&str, &str); 7] = [
    (
        "schema/vehicle.json",
        include_str!("../../docs/schema/vehicle.json"),
    ),
    (
        "schema/contact_vehicle.json",
        include_str!("../../docs/schema/contact_vehicle.json"),
    ),
    (
        "schema/scenario.json",
        include_str!("../../docs/schema/scenario.json"),
    ),
    (
        "schema/columns.json",
        include_str!("../../docs/schema/columns.json"),
    ),
    (
        "schema/run.json",
        include_str!("../../docs/schema/run.json"),
    ),
    (
        "schema/virtual_rover.json",
        include_str!("../../docs/schema/virtual_rover.json"),
    ),
    (
        "schema/can.json",
        include_str!("../../docs/schema/can.json"),
    ),
];

/// Returns the schemas that a set's files name.
pub(super) fn schemas(files: &[File]) -> Vec<File> {
    let named = |name: &str| files.iter().any(|file| schema_of(file.name) == Some(name));
    SCHEMA_FILES
        .iter()
        .filter(|(name, _)| named(name))
        .map(|(name, text)| File {
            name,
            text: (*text).to_owned(),
        })
        .collect()
}

/// Returns the schema of a file of a set, if it has one.
fn schema_of(name: &str) -> Option<&'static str> {
    Some(match name {
        "vehicle.yaml" | "identified.yaml" => "schema/vehicle.json",
        "contact.yaml" => "schema/contact_vehicle.json",
        "scenario.yaml" => "schema/scenario.json",
        "columns.yaml" => "schema/columns.json",
        "run.yaml" => "schema/run.json",
        "virtual.yaml" => "schema/virtual_rover.json",
        "can.yaml" => "schema/can.json",
        _ => return None,
    })
}

/// Names its schema in a file's first line, for editors.
pub(super) fn name_schema(file: &mut File) {
    const MARK: &str = "# yaml-language-server: $schema=";
    let Some(schema) = schema_of(file.name) else {
        return;
    };
    let rest = match file.text.split_once('\n') {
        // The repository's own, which names another folder.
        Some((first, rest)) if first.starts_with(MARK) => rest,
        _ => &file.text,
    };
    file.text = format!("{MARK}{schema}\n{rest}");
}
