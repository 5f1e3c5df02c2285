//! Serialised forms of types that serde does not cover.

/// A matrix as its rows.
pub(crate) mod rows {
    use nalgebra::SMatrix;
    use serde::de::Error;
    use serde::{Deserialize, Deserializer, Serializer};

    pub(crate) fn serialize<S: Serializer, const R: usize, const C: usize>(
        matrix: &SMatrix<f64, R, C>,
        serializer: S,
    ) -> Result<S::Ok, S::Error> {
        serializer.collect_seq(
            matrix
                .row_iter()
                .map(|row| row.iter().copied().collect::<Vec<_>>()),
        )
    }

    pub(crate) fn deserialize<'de, D: Deserializer<'de>, const R: usize, const C: usize>(
        deserializer: D,
    ) -> Result<SMatrix<f64, R, C>, D::Error> {
        let rows = Vec::<Vec<f64>>::deserialize(deserializer)?;
        if rows.len() != R || rows.iter().any(|row| row.len() != C) {
            return Err(D::Error::custom(format!("not {R} rows of {C} numbers")));
        }
        Ok(SMatrix::from_fn(|i, j| rows[i][j]))
    }
}

/// A vector as its entries.
pub(crate) mod entries {
    use nalgebra::Vector3;
    use serde::{Deserialize, Deserializer, Serialize, Serializer};

    pub(crate) fn serialize<S: Serializer>(
        vector: &Vector3<f64>,
        serializer: S,
    ) -> Result<S::Ok, S::Error> {
        [vector.x, vector.y, vector.z].serialize(serializer)
    }

    pub(crate) fn deserialize<'de, D: Deserializer<'de>>(
        deserializer: D,
    ) -> Result<Vector3<f64>, D::Error> {
        Ok(<[f64; 3]>::deserialize(deserializer)?.into())
    }
}

/// An age as a number, or as nothing where it is infinite because there has been no reading.
pub(crate) mod age {
    use serde::{Deserialize, Deserializer, Serialize, Serializer};

    pub(crate) fn serialize<S: Serializer>(age_s: &f64, serializer: S) -> Result<S::Ok, S::Error> {
        age_s.is_finite().then_some(*age_s).serialize(serializer)
    }

    pub(crate) fn deserialize<'de, D: Deserializer<'de>>(deserializer: D) -> Result<f64, D::Error> {
        Ok(Option::deserialize(deserializer)?.unwrap_or(f64::INFINITY))
    }
}
