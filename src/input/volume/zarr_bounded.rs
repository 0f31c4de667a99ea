//! Codecs of Zarr that unpack no more than the metadata say that a chunk, or a chunk in a shard, holds.
//!
//! Those of zarrs unpack whatever there is and compare its size afterwards: 1 KB becomes gigabytes first. Here each of them that may grow stands in a
//! [`Bounded`], which knows the limit from the chain of codecs it is in.

use std::any::Any;
use std::borrow::Cow;
use std::io::Read;
use std::sync::{Arc, Once};

use flate2::bufread::{GzDecoder, ZlibDecoder};
use zarrs::array::codec::api::{
    CodecRuntimePluginV2, CodecRuntimePluginV3, PartialDecoderCapability, PartialEncoderCapability, register_codec_v2,
    register_codec_v3,
};
use zarrs::array::codec::{GzipCodec, ZlibCodec};
use zarrs::array::{
    ArrayBytesRaw, BytesRepresentation, BytesToBytesCodecTraits, Codec, CodecError, CodecMetadataOptions, CodecOptions,
    CodecTraits, CodecTraitsV2, CodecTraitsV3, RecommendedConcurrency,
};
use zarrs::metadata::Configuration;
use zarrs::plugin::{ExtensionAliasesV2, ExtensionAliasesV3, ExtensionName, PluginCreateError, ZarrVersion};

/// Unpacks at most so many bytes, or says what there is instead.
type Unpack = fn(&[u8], usize) -> Result<Vec<u8>, String>;

/// A codec of zarrs with an [`Unpack`] in place of its own.
#[derive(Debug)]
struct Bounded {
    codec: Arc<dyn BytesToBytesCodecTraits>,
    unpack: Unpack,
}

/// Puts the bounded codecs in the place of zarrs' own, once in the life of the program.
pub(crate) fn register() {
    static ONCE: Once = Once::new();
    ONCE.call_once(|| {
        bound::<GzipCodec>(gzip);
        bound::<ZlibCodec>(zlib);
        #[cfg(feature = "blosc")]
        bound::<zarrs::array::codec::BloscCodec>(blosc);
        #[cfg(feature = "zstd")]
        bound::<zarrs::array::codec::ZstdCodec>(zstd);
    });
}

fn bound<C: CodecTraitsV2 + CodecTraitsV3 + ExtensionAliasesV2 + ExtensionAliasesV3 + 'static>(unpack: Unpack) {
    let bounded = move |codec: Codec| match codec {
        Codec::BytesToBytes(codec) => Codec::BytesToBytes(Arc::new(Bounded { codec, unpack })),
        other => other,
    };
    register_codec_v2(CodecRuntimePluginV2::new(C::matches_name_v2, move |metadata| {
        <C as CodecTraitsV2>::create(metadata).map(bounded)
    }));
    register_codec_v3(CodecRuntimePluginV3::new(
        C::matches_name_v3,
        move |metadata| -> Result<Codec, PluginCreateError> { <C as CodecTraitsV3>::create(metadata).map(bounded) },
    ));
}

fn gzip(packed: &[u8], most: usize) -> Result<Vec<u8>, String> {
    within("gzip", GzDecoder::new(packed), most)
}

fn zlib(packed: &[u8], most: usize) -> Result<Vec<u8>, String> {
    within("zlib", ZlibDecoder::new(packed), most)
}

/// All that a decoder unpacks, if that is not too much.
fn within(packing: &str, decoder: impl Read, most: usize) -> Result<Vec<u8>, String> {
    let mut bytes = Vec::new();
    let mut left = decoder.take((most as u64).saturating_add(1));
    left.read_to_end(&mut bytes).map_err(|e| format!("{packing}: {e}"))?;
    if bytes.len() > most { Err(too_much(packing, "more".into(), most)) } else { Ok(bytes) }
}

/// A chunk of Blosc says its size in bytes 4 to 7; c-blosc unpacks no more than that.
#[cfg(feature = "blosc")]
fn blosc(packed: &[u8], most: usize) -> Result<Vec<u8>, String> {
    use zarrs::array::codec::{blosc_decompress_bytes, blosc_validate};

    let said = blosc_validate(packed).ok_or("Blosc: the chunk is damaged")?;
    if said > most {
        return Err(too_much("Blosc", format!("{said} bytes"), most));
    }
    if said == 0 { Ok(Vec::new()) } else { blosc_decompress_bytes(packed, said, 1).map_err(|e| format!("Blosc: {e}")) }
}

#[cfg(feature = "zstd")]
fn zstd(packed: &[u8], most: usize) -> Result<Vec<u8>, String> {
    within("zstd", zstd::Decoder::with_buffer(packed).map_err(|e| format!("zstd: {e}"))?, most)
}

fn too_much(packing: &str, found: String, most: usize) -> String {
    format!("{packing} unpacks to {found}, but its metadata say that it holds at most {most} bytes")
}

impl ExtensionName for Bounded {
    fn name(&self, version: ZarrVersion) -> Option<Cow<'static, str>> {
        self.codec.name(version)
    }
}

impl CodecTraits for Bounded {
    fn as_any(&self) -> &dyn Any {
        self.codec.as_any()
    }

    fn configuration(&self, version: ZarrVersion, options: &CodecMetadataOptions) -> Option<Configuration> {
        self.codec.configuration(version, options)
    }

    fn partial_decoder_capability(&self) -> PartialDecoderCapability {
        PartialDecoderCapability { partial_read: false, partial_decode: false }
    }

    fn partial_encoder_capability(&self) -> PartialEncoderCapability {
        PartialEncoderCapability { partial_encode: false }
    }
}

impl BytesToBytesCodecTraits for Bounded {
    fn into_dyn(self: Arc<Self>) -> Arc<dyn BytesToBytesCodecTraits> {
        self
    }

    fn recommended_concurrency(&self, decoded: &BytesRepresentation) -> Result<RecommendedConcurrency, CodecError> {
        self.codec.recommended_concurrency(decoded)
    }

    fn encoded_representation(&self, decoded: &BytesRepresentation) -> BytesRepresentation {
        self.codec.encoded_representation(decoded)
    }

    fn encode<'a>(&self, bytes: ArrayBytesRaw<'a>, options: &CodecOptions) -> Result<ArrayBytesRaw<'a>, CodecError> {
        self.codec.encode(bytes, options)
    }

    fn decode<'a>(
        &self,
        packed: ArrayBytesRaw<'a>,
        decoded: &BytesRepresentation,
        _: &CodecOptions,
    ) -> Result<ArrayBytesRaw<'a>, CodecError> {
        let most = decoded.size().and_then(|size| usize::try_from(size).ok());
        let most = most.ok_or_else(|| CodecError::Other("its metadata do not bound the size of a chunk".into()))?;
        (self.unpack)(&packed, most).map(Cow::Owned).map_err(CodecError::Other)
    }
}
