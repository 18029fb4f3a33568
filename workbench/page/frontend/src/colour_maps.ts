/** Colour maps, perceptually uniform and told apart by colour-blind readers: 33 colours each, from least to most.
 *
 * magma_r, viridis, magma and cividis are those of matplotlib, which are in the public domain (CC0). magma_r, from the
 * pale of bone to black, is what figures of a report show depth in.
 */
export const COLOUR_MAPS: Readonly<Record<string, string>> = {
  grey:
    "000000080808101010181818202020282828303030383838404040484848505050585858606060686868707070787878" +
    "808080888888909090989898a0a0a0a8a8a8b0b0b0b8b8b8c0c0c0c8c8c8d0d0d0d8d8d8e0e0e0e8e8e8f0f0f0f8f8f8" +
    "ffffff",
  magma_r:
    "fcfdbffceeb0fde0a1fed194fec287feb47bfea571fd9668fb8761f9785df4695cee5b5ee55064db476acf4070c23b75" +
    "b5367aa8327d9b2e7f8e2a81812581752181681c815c167f4f127b420f753410692712581c1044120d3109072003030f" +
    "000004",
  viridis:
    "440154470d6048186a482374472d7b4537814240863e49893b528b375b8d33638d2f6b8e2c728e297a8e26828e23898e" +
    "21918c1f988b1fa08822a78528ae8032b67a3fbc734ec36b5ec96270cf5784d44b98d83eaddc30c2df23d8e219ece51b" +
    "fde725",
  magma:
    "0000040303120a0822130d341d114729115a36106b440f7651127c5d177f6a1c81762181832681902a819c2e7faa337d" +
    "b73779c43c75d0416fdc4869e75263ef5d5ef56b5cf9795dfc8961fd9869fea772feb67cfec488fed395fde2a3fcf0b2" +
    "fcfdbf",
  cividis:
    "00224e00285b002e6a0533711a386f273e6e32436d3b496c434e6c4b546c535a6d5a5f6e61656f686a716f7073767676" +
    "7d7c788482798c8878938e789b9476a39a74aba072b4a76fbcae6cc4b468cdbb63d5c25edec958e7d150f0d846f9e03a" +
    "fee838",
};

export type ColourMap = keyof typeof COLOUR_MAPS;
