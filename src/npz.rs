//! Arrays in NumPy's format npz: a ZIP archive, without compression, of one file of format npy an array.

use anyhow::{Context, Result};

/// The CRC-32 of ZIP.
const CRC: crc::Crc<u32> = crc::Crc::<u32>::new(&crc::CRC_32_ISO_HDLC);
/// Where the data of an npy file begin is a multiple of this.
const ALIGNMENT: usize = 64;
/// The first version of ZIP, which readers must know at least.
const VERSION: u16 = 10;
/// 1980-01-01, the first day of ZIP.
const DATE: u16 = 0x21;

/// An archive under way.
#[derive(Default)]
pub(crate) struct Npz {
    files: Vec<u8>,
    directory: Vec<u8>,
    count: u16,
}

impl Npz {
    /// Adds an array of whole numbers, row by row.
    ///
    /// # Errors
    /// The archive is larger than the 4 GiB of its format.
    pub(crate) fn integers(&mut self, name: &str, shape: &[usize], values: &[i64]) -> Result<()> {
        self.add(
            name,
            "<i8",
            shape,
            values.iter().map(|value| value.to_le_bytes()),
        )
    }

    /// Adds an array of floats, row by row.
    ///
    /// # Errors
    /// As [`Self::integers`].
    pub(crate) fn floats(&mut self, name: &str, shape: &[usize], values: &[f64]) -> Result<()> {
        self.add(
            name,
            "<f8",
            shape,
            values.iter().map(|value| value.to_le_bytes()),
        )
    }

    fn add(
        &mut self,
        name: &str,
        kind: &str,
        shape: &[usize],
        values: impl Iterator<Item = [u8; 8]>,
    ) -> Result<()> {
        let shape: String = shape.iter().map(|size| format!("{size}, ")).collect();
        let header = format!("{{'descr': '{kind}', 'fortran_order': False, 'shape': ({shape}), }}");
        // Magic, version, and two bytes of length; the header ends with a line break.
        let padded = (10 + header.len() + 1).next_multiple_of(ALIGNMENT) - 10;
        let mut file = b"\x93NUMPY\x01\0".to_vec();
        file.extend(u16::try_from(padded)?.to_le_bytes());
        file.extend(format!("{header:0$}\n", padded - 1).bytes());
        file.extend(values.flatten());

        let name = format!("{name}.npy");
        let (size, start) = (in_zip(file.len())?, in_zip(self.files.len())?);
        // What both the file's header and the directory have: no flags, no compression.
        let mut entry = Vec::new();
        entry.extend([VERSION, 0, 0, 0, DATE].map(u16::to_le_bytes).concat());
        entry.extend(
            [CRC.checksum(&file), size, size]
                .map(u32::to_le_bytes)
                .concat(),
        );
        entry.extend(
            [u16::try_from(name.len())?, 0]
                .map(u16::to_le_bytes)
                .concat(),
        );

        self.files.extend(b"PK\x03\x04");
        self.files.extend(&entry);
        self.files.extend(name.bytes());
        self.files.append(&mut file);

        self.directory.extend(b"PK\x01\x02");
        self.directory.extend(VERSION.to_le_bytes());
        self.directory.extend(&entry);
        // No comment, one disk, no attributes.
        self.directory.extend([0; 10]);
        self.directory.extend(start.to_le_bytes());
        self.directory.extend(name.bytes());
        self.count += 1;
        Ok(())
    }

    /// Returns the bytes of the archive.
    ///
    /// # Errors
    /// As [`Self::integers`].
    pub(crate) fn finish(mut self) -> Result<Vec<u8>> {
        let (start, size) = (in_zip(self.files.len())?, in_zip(self.directory.len())?);
        self.files.append(&mut self.directory);
        self.files.extend(b"PK\x05\x06");
        self.files.extend(
            [0, 0, self.count, self.count]
                .map(u16::to_le_bytes)
                .concat(),
        );
        self.files
            .extend([size, start].map(u32::to_le_bytes).concat());
        self.files.extend([0; 2]);
        Ok(self.files)
    }
}

fn in_zip(bytes: usize) -> Result<u32> {
    u32::try_from(bytes).context("more than 4 GiB, the largest archive; record a shorter run")
}
