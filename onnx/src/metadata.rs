//! The contract as key and value strings in the ONNX file's metadata.

use crate::contract::*;
use crate::error::Error;
use crate::messages::StringStringEntryProto;
use sspc_core::composition::Composition;
use sspc_core::prepare::Exposure;
use sspc_image::{Role, shown};
use sspc_kernels::features::{CHANNEL_NAMES, FeatureSet};
use sspc_kernels::network::Shape;
use sspc_kernels::parameters::Form;
use std::collections::BTreeMap;

const PREFIX: &str = "sspc.";
const EXTRA: &str = "sspc.extra.";
/// Separates the paths in a list of frames.
const FRAME_SEPARATOR: &str = "\n";

/// All entries in a fixed order, so that equal models give equal bytes. Optional ones come first: a truncated file then
/// lacks a required one.
pub(crate) fn write(contract: &Contract) -> Vec<StringStringEntryProto> {
    let Contract { form, shape, features, .. } = contract;
    let required = [
        ("contract", contract.version().to_string()),
        ("form", form_name(*form).to_string()),
        ("input_channels", CHANNEL_NAMES.join(",")),
        ("output_channels", form.parameter_names().join(",")),
        ("activations", ACTIVATIONS.to_string()),
        ("exposure", exposure_name(contract.exposure).to_string()),
        ("exposure_rule", exposure_rule(contract.exposure).to_string()),
        ("padding", PADDING.to_string()),
        ("window_radius", contract.window_radius.to_string()),
        ("composition", composition_name(contract.composition).to_string()),
        ("hidden_channels", shape.hidden.to_string()),
        ("convolutions", shape.layers.to_string()),
        ("features", features.names(",")),
        ("seed", contract.seed.to_string()),
        ("steps", contract.steps.to_string()),
        ("preset", contract.preset.clone()),
        ("frames", contract.frames.join(FRAME_SEPARATOR)),
        ("tool", contract.tool.clone()),
    ]
    .into_iter()
    .map(|(key, value)| (format!("{PREFIX}{key}"), value));
    let networks = (contract.networks > 1).then(|| (format!("{PREFIX}networks"), contract.networks.to_string()));
    let frames = contract.extra_frames;
    let extra_frames = (frames > 0).then(|| (format!("{PREFIX}extra_frames"), frames.to_string()));
    let differences = contract.differences;
    let differences = (differences > 0.0).then(|| (format!("{PREFIX}differences"), differences.to_string()));
    let extra = contract.extra.iter().map(|(k, v)| (format!("{EXTRA}{k}"), v.clone()));
    extra
        .chain(networks)
        .chain(extra_frames)
        .chain(differences)
        .chain(required)
        .map(|(key, value)| StringStringEntryProto { key: Some(key), value: Some(value) })
        .collect()
}

/// Reads the entries back.
///
/// # Errors
/// [`Error::Version`] first, so that a newer contract is reported as such; then [`Error::MissingKey`] and
/// [`Error::Key`].
pub(crate) fn read(entries: &[StringStringEntryProto]) -> Result<Contract, Error> {
    let entries =
        Entries(entries.iter().map(|e| (e.key.as_deref().unwrap_or(""), e.value.as_deref().unwrap_or(""))).collect());
    let (networks, extra_frames) = match entries.text("contract")? {
        version if version == CONTRACT_VERSION.to_string() => (1, 0),
        version if version == SEVERAL_NETWORKS_VERSION.to_string() => (entries.within("networks", 2, MAX_NETWORKS)?, 0),
        version if version == SHOT_VERSION.to_string() => {
            let networks = if entries.has("networks") { entries.within("networks", 2, MAX_NETWORKS)? } else { 1 };
            (networks, entries.within("extra_frames", 1, MAX_EXTRA_FRAMES)?)
        }
        version if version == DIFFERENCES_VERSION.to_string() => {
            let networks = if entries.has("networks") { entries.within("networks", 2, MAX_NETWORKS)? } else { 1 };
            let frames =
                if entries.has("extra_frames") { entries.within("extra_frames", 1, MAX_EXTRA_FRAMES)? } else { 0 };
            (networks, frames)
        }
        version => return Err(Error::Version { expected: DIFFERENCES_VERSION, found: shown(version) }),
    };
    let differences = match entries.text("contract")? {
        version if version == DIFFERENCES_VERSION.to_string() => entries.differences()?,
        _ => 0.0,
    };
    let form = match entries.text("form")? {
        "paper" => Form::Paper,
        "gated" => Form::Gated,
        found => return Err(key_error("form", "`paper` or `gated`", found)),
    };
    entries.same("input_channels", &CHANNEL_NAMES.join(","))?;
    entries.same("output_channels", &form.parameter_names().join(","))?;
    entries.same("activations", ACTIVATIONS)?;
    let exposure = match entries.text("exposure")? {
        "as-is" => Exposure::AsIs,
        "normalised" => Exposure::Normalised,
        "of-noise" => Exposure::OfNoise,
        found => return Err(key_error("exposure", "`as-is`, `normalised` or `of-noise`", found)),
    };
    if entries.text("exposure_rule")? != earlier_exposure_rule(exposure) {
        entries.same("exposure_rule", exposure_rule(exposure))?;
    }
    entries.same("padding", PADDING)?;
    let shape = Shape {
        hidden: entries.within("hidden_channels", 1, MAX_HIDDEN)?,
        layers: entries.within("convolutions", 1, MAX_LAYERS)?,
        outputs: form.parameters(),
    };
    Ok(Contract {
        form,
        shape,
        networks,
        extra_frames,
        differences,
        window_radius: entries.within("window_radius", 1, MAX_WINDOW_RADIUS)?,
        composition: match entries.text("composition")? {
            "mean-of-halves" => Composition::MeanOfHalves,
            "judged-full-buffer" => Composition::JudgedFullBuffer,
            found => return Err(key_error("composition", "`mean-of-halves` or `judged-full-buffer`", found)),
        },
        exposure,
        seed: entries.number("seed")?,
        frames: entries.frames()?,
        tool: entries.text("tool")?.to_string(),
        preset: entries.text("preset")?.to_string(),
        steps: entries.number("steps")?,
        features: entries.features()?,
        extra: entries.extra(),
    })
}

fn exposure_name(exposure: Exposure) -> &'static str {
    match exposure {
        Exposure::AsIs => "as-is",
        Exposure::Normalised => "normalised",
        Exposure::OfNoise => "of-noise",
    }
}

fn composition_name(composition: Composition) -> &'static str {
    match composition {
        Composition::MeanOfHalves => "mean-of-halves",
        Composition::JudgedFullBuffer => "judged-full-buffer",
    }
}

fn key_error(key: &str, expected: impl Into<String>, found: &str) -> Error {
    Error::Key { key: format!("{PREFIX}{key}"), expected: expected.into(), found: shown(found) }
}

struct Entries<'a>(BTreeMap<&'a str, &'a str>);

impl<'a> Entries<'a> {
    fn text(&self, key: &str) -> Result<&'a str, Error> {
        let key = format!("{PREFIX}{key}");
        self.0.get(key.as_str()).copied().ok_or(Error::MissingKey { key })
    }

    fn has(&self, key: &str) -> bool {
        self.0.contains_key(format!("{PREFIX}{key}").as_str())
    }

    fn same(&self, key: &str, expected: &str) -> Result<(), Error> {
        match self.text(key)? {
            found if found == expected => Ok(()),
            found => Err(key_error(key, format!("`{expected}`"), found)),
        }
    }

    fn number(&self, key: &str) -> Result<u64, Error> {
        let text = self.text(key)?;
        text.parse().map_err(|_| key_error(key, "a whole number", text))
    }

    fn within(&self, key: &str, low: usize, high: usize) -> Result<usize, Error> {
        let text = self.text(key)?;
        text.parse()
            .ok()
            .filter(|n| (low..=high).contains(n))
            .ok_or_else(|| key_error(key, format!("a whole number in {low}..={high}"), text))
    }

    fn differences(&self) -> Result<f32, Error> {
        let text = self.text("differences")?;
        let usable = |s: &f32| *s > 0.0 && *s <= MAX_DIFFERENCES;
        text.parse()
            .ok()
            .filter(usable)
            .ok_or_else(|| key_error("differences", format!("a number above 0, at most {MAX_DIFFERENCES}"), text))
    }

    fn frames(&self) -> Result<Vec<String>, Error> {
        let text = self.text("frames")?;
        Ok(text.split(FRAME_SEPARATOR).filter(|f| !f.is_empty()).map(str::to_string).collect())
    }

    fn features(&self) -> Result<FeatureSet, Error> {
        let text = self.text("features")?;
        let mut features = FeatureSet::NONE;
        for name in text.split(',').filter(|name| !name.is_empty()) {
            let role = Role::FEATURES.into_iter().find(|role| role.name() == name);
            let role = role.ok_or_else(|| key_error("features", FeatureSet::ALL.names(", "), text))?;
            features = features.union(FeatureSet::of(|feature| feature == role));
        }
        Ok(features)
    }

    fn extra(&self) -> BTreeMap<String, String> {
        self.0.iter().filter_map(|(k, v)| Some((k.strip_prefix(EXTRA)?.to_string(), v.to_string()))).collect()
    }
}
